"""The options of every command: one frozen record each, from which the command line and its pages are made.

Rules of this room: no heavy import at the top of a module, so that the daemon starts fast; a record says what may be
asked, what a value means is judged by the command that is handed the record.
"""
