"""State-space methods: subspace, realisation from impulse responses, prediction error, grey boxes."""
