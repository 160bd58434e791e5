"""Networks of other papers, raced against ours."""
