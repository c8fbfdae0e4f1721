"""What `tools/figures.py` computes before it draws: one module for each part of the thesis."""
