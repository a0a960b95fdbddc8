"""The stages as a library: settings from a scene, the structure built once, its responses; every story is told with these."""
