"""The diagnosis for a person: terminal, page, figures, words."""
