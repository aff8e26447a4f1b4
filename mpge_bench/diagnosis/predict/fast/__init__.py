"""The diagnosis' inner loops, compiled: motors' hidden sides, tree dynamics and windows, recurrences. Each agrees with what it stands in for (tested)."""
