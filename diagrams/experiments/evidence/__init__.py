"""From runs to the file of results, the README's tables and the gate."""
