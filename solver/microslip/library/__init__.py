"""The library interface: settings from a scene, a structure built once, its responses.  All commands use it."""
