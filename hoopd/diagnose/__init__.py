"""From recordings that a model does not explain to the physics that it leaves out."""
