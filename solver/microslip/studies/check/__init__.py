"""What a scene or a model file holds, and what a run will need; nothing is solved."""
