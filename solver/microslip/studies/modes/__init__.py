"""The command `modes`: modes of a scene with all pairs stuck; table, picture, shapes for ParaView."""
