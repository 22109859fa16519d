"""The evidence: closed forms, other engines and the paper, each beside this simulator, with numbers and figures."""
