"""Solvers of a horizon's problem: SQP with two solvers of its quadratic programs, or SNOPT and IPOPT on the whole."""
