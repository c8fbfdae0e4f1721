"""The ball in a motor-driven hoop: the one place offline that names the angles theta and psi."""
