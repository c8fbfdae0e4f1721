"""What a plant is: its declaration, effects, free runs and fits; each plant is a module or a folder of its own."""
