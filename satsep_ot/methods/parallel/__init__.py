"""Many runs of a function: chunks on any executor, streams of Monte Carlo runs."""
