"""The web page and the HTTP API: one more client of the local API, in a process of its own.

    a browser or any program  ->  access.py (who may come in)  ->  server.py (what there is)
        ->  viewer.py (one connection, for all who look)  and  owning.py (one connection for each page that commands)

What comes in: HTTP and WebSocket messages, `messages.py`, all of them described by `/openapi.json`; from loopback, or from
elsewhere by TLS and from users who logged in. What goes out: what `gateway.client` asks for.
Read `server.py` first. Needs the extra `web`; nothing here is loaded by any other part.
"""
