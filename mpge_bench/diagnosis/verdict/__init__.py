"""What is said of the answer: a typed result, its intervals, what it may be mistaken for, where it acts."""
