"""Results in; tables, plots and the page out."""
