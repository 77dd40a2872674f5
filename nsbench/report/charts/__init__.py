"""Charts as Vega-Lite specifications: layout in `layouts`, data in `payload`, files in `files`.

The page of the report, a notebook and a file of SVG or PDF show the same specification. Data are
apart from it: a layout names the data set "points", which whoever draws it fills with rows.
Source: Satyanarayan, Moritz, Wongsuphasawat, Heer (2017), Vega-Lite: a grammar of interactive
graphics, IEEE TVCG 23.
"""
