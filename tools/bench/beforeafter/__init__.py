"""An earlier state of the program beside this one: what the two find, and how long they take."""
