"""The web page: a process of its own that listens to daemons over zenoh and shows what they tell.

Rules of this room: it reaches a daemon by the documented keys alone, never by its code; the daemon never imports it.
Whatever comes from a device or from a browser is data of a stranger: bounded, checked, shown as text. Nobody waits for
a slow browser, and nothing is fetched from anywhere but this server.
"""
