"""The local API, all that a client must know: keys, messages, encodings, sizes and where the daemon is.

```
key                                   what                                  who sends        message
ta2/stop, ta2/estop                   whatever arrives is the stop          anybody            (anything) -> Reply
ta2/ping                              query: whether a stop would be answered  anybody      (anything) -> (empty)
ta2/1/command                         query, exactly one reply              client           Command -> Reply
ta2/1/command/<user>                  the same, of a user with a role of his own   client   Command -> Reply
ta2/1/info                            query                                 client           (empty) -> Info
ta2/1/routes                          query                                 client           (empty) -> Routes
ta2/1/snapshot                        query: the newest one                 client           (empty) -> Snapshot
ta2/1/snapshot                        put at 50 Hz while somebody listens   daemon           Snapshot, seq attached
ta2/1/event                           put                                   daemon           Notice, number attached
ta2/1/target/<client>/<stream>/<secret>  put, the newest wins               client           Target
ta2/1/keepalive/<client>/<secret>     put every 50 ms by the owner          client           (empty)
ta2/1/check_in/<client>/<secret>      put by stop endpoints                 client           (empty)
ta2/1/alive/daemon/<id>               liveliness token                      daemon
ta2/1/alive/client/<client>           liveliness token                      client
ta2/1/alive/user/<user>               liveliness token, seen by that user alone  daemon
ta2/1/alive/member/<id>               liveliness token, in a fleet          `ta2 fleet join`
```

On a fleet's router the same keys stand behind `fleet/<name>/`; zenoh's `namespace` puts it there and takes it away.

Rules
    * The number in the keys is the version. Tokens of another version tell a client that the releases do not match.
    * msgpack (`application/msgpack`) or JSON (`application/json`), as the zenoh encoding of the query says; the reply
      uses the same. Puts of the daemon are msgpack. No encoding means msgpack.
    * A payload above `MAX_PAYLOAD_BYTES` is refused before it is looked at.

This module and what it imports are all that `gateway.client` knows of the daemon: msgspec, the standard library,
`gateway.messages`, `gateway.values` and `gateway.errors`. It opens nothing and sends nothing.
"""

from __future__ import annotations

from gateway.api import address, encoding, keys
from gateway.api.address import *
from gateway.api.encoding import *
from gateway.api.keys import *
from gateway.messages import envelopes, facts, incoming, requests, snapshot, wire
from gateway.messages.envelopes import *
from gateway.messages.facts import *
from gateway.messages.incoming import *
from gateway.messages.requests import *
from gateway.messages.snapshot import *
from gateway.messages.wire import *
from gateway.values import Side, Space

__all__ = ["Side", "Space"]
__all__ += address.__all__
__all__ += encoding.__all__
__all__ += keys.__all__
__all__ += envelopes.__all__
__all__ += facts.__all__
__all__ += incoming.__all__
__all__ += requests.__all__
__all__ += snapshot.__all__
__all__ += wire.__all__
