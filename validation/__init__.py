"""The evidence: closed forms, other engines, the paper and benchmarks, each beside this simulator, with numbers."""
