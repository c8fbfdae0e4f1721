"""What a worker begins with: everything that the commands load, loaded once and then forked."""

from fuzzing import inprocess

inprocess.warm()
