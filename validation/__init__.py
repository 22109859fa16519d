"""The evidence: this simulator compared with closed forms, other engines, the paper and benchmarks, in numbers."""
