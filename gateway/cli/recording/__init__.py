"""`ta2 record`, `ta2 episode` and `ta2 bag`: bags recorded, looked at and judged. Arguments in, words or JSON out."""
