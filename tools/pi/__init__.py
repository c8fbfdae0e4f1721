"""The Raspberry Pi's userland and its service manager, tried on another machine."""
