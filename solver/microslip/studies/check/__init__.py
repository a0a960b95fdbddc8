"""The command `check`: the content of a scene or a model file, and the resources of a run; nothing is solved."""
