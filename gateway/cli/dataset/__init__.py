"""Commands of `ta2 dataset`: datasets built from bags, judged, drawn, compared, put together and taken apart.

In: folders of bags or datasets, a layout in TOML. No robot and no gateway.
Out: datasets, pictures and pages, words or JSON.
Read first: `build.py`.
"""
