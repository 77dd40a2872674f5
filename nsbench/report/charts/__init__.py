"""Charts as Vega-Lite specifications: layouts, the page's data, files.

`layouts` has the charts without data, `payload` the data of the page, `studies` charts with the
data of a study or a trajectory, `bar_texts` the error bars of runs in words, `files` what writes
all of them. The page of the report, a notebook and a
file of SVG or PDF show the same specification. Data are apart from it: a layout names the data set
"points", which whoever draws it fills with rows.
Source: Satyanarayan, Moritz, Wongsuphasawat, Heer (2017), Vega-Lite: a grammar of interactive
graphics, IEEE TVCG 23.
"""
