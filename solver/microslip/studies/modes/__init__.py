"""The modes of a scene with all pairs stuck: table, picture, shapes for ParaView; no vibration is solved for."""
