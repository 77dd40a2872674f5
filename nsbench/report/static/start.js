// Start what needs the data; where it cannot be read, the static page stays as it is.
player.startAll();
nsbench
  .load()
  .then((data) => {
    if (!data) {
      return;
    }
    document.documentElement.classList.add("live-page");
    if (document.getElementById("answer-error")) {
      answer.start();
      explore.startErrors();
      explore.startScatter();
      explore.startBars();
      explore.startOrders();
      explore.startCases();
      explore.startKeys();
    }
    // a change of theme, or paper: draw again in the colours of the page
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      for (const [element, { spec, description }] of [...nsbench.drawn]) {
        const again = structuredClone(spec);
        nsbench.recolour(again, new Set(again.datasets.points.map((row) => row.method)));
        nsbench.draw(element, again, description);
      }
    });
  });
