"""Every figure, drawn without a screen."""
