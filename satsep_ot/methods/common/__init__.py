"""What all methods share: standard space, storage, linear algebra on one thread."""
