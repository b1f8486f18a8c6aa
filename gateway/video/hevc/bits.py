"""Reads bits and Exp-Golomb numbers out of a NAL unit (H.265 section 9.2), emulation prevention taken out (7.4.2)."""

from __future__ import annotations

__all__ = ["BitReader", "BitsEnded"]

MAX_ZEROS = 32
"""No Exp-Golomb number of the standard is longer."""


class BitsEnded(ValueError):
    """The NAL unit ends before what is to be read does, or is no such thing."""


class BitReader:
    """Reads from the front.

    Args:
        data: Bytes of a NAL unit, from behind its header on; with emulation prevention.
    """

    def __init__(self, data: bytes) -> None:
        raw = data.replace(b"\x00\x00\x03", b"\x00\x00")
        self._bits = int.from_bytes(raw, "big")
        self._left = 8 * len(raw)

    def read(self, count: int) -> int:
        """Return a number of so many bits.

        Raises:
            BitsEnded: If fewer are left.
        """
        if count > self._left:
            raise BitsEnded(f"{count} bits wanted, {self._left} left")
        self._left -= count
        return (self._bits >> self._left) & ((1 << count) - 1)

    def unsigned(self) -> int:
        """Return an unsigned Exp-Golomb number.

        Raises:
            BitsEnded: If it does not end.
        """
        zeros = 0
        while not self.read(1):
            zeros += 1
            if zeros > MAX_ZEROS:
                raise BitsEnded(f"more than {MAX_ZEROS} zeros before a number")
        return (1 << zeros) - 1 + self.read(zeros)

    def signed(self) -> int:
        """Return a signed Exp-Golomb number.

        Raises:
            BitsEnded: If it does not end.
        """
        code = self.unsigned()
        return (code + 1) // 2 if code % 2 else -(code // 2)
