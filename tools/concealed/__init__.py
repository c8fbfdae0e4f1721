"""The proof: a generator of recordings with concealed effects, sealed answers, and the scorer of `hoopd diagnose`."""
