"""H.265 as it comes off the network: bits, NAL units, parameter sets, coded pictures (H.265, RFC 7798).

In: payloads of RTP packets.
Out: coded pictures with what is known of them.
Read first: `access_unit.py`.
"""
