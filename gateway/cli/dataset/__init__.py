"""Commands of `ta2` about datasets: built from bags, and judged. Folders in, folders and words or JSON out."""
