"""Active subspaces, polynomial regression and reliability for any OpenTURNS function."""
