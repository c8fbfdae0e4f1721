"""What the findings are worth: free runs, ablations, placebos, what is not told apart, the next experiment."""
