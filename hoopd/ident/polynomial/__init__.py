"""Polynomial models: ARX, AR, ARMA, ARARX, ARMAX, output error and Box-Jenkins, their orders and delays."""
