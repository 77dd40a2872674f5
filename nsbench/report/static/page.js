// Behaviour of the report: pictures put in place, filter of the table of orders, printing.
// Without it the page shows everything.

// Jumps to places of the page. Sections are laid out, and get their height, as they come into view:
// a jump is made again until its target stays where it is.
const jump = {
  DELAYS: [0, 100, 300, 700, 1500],
  last: 0,

  to(id) {
    const target = document.getElementById(id);
    const own = ++jump.last;
    for (let around = target; around; around = around.parentElement) {
      if (around.tagName === "DETAILS") {
        around.open = true;
      }
    }
    for (const delay of jump.DELAYS) {
      setTimeout(() => own === jump.last && target?.scrollIntoView(), delay);
    }
  },

  start() {
    const go = () => location.hash && jump.to(decodeURIComponent(location.hash.slice(1)));
    addEventListener("hashchange", go);
    document.addEventListener("click", (event) => {
      const link = event.target.closest?.('a[href^="#"]');
      if (link && link.hash === location.hash) {
        go();
      }
    });
    // who scrolls by hand is not called back
    for (const name of ["wheel", "touchmove", "keydown", "pointerdown"]) {
      addEventListener(name, () => jump.last++, { passive: true });
    }
    go();
  },
};

// Static pictures stand in noscript elements, which a browser with scripts does not parse: each is
// put in place when what holds it comes near the screen, and all of them for paper.
const pictures = {
  put(noscript) {
    const parsed = document.createElement("template");
    parsed.innerHTML = noscript.textContent;
    noscript.replaceWith(parsed.content);
  },

  start() {
    const observer = new IntersectionObserver(
      (entries) => {
        for (const { target } of entries.filter((entry) => entry.isIntersecting)) {
          observer.unobserve(target);
          target.querySelectorAll("noscript").forEach(pictures.put);
        }
      },
      { rootMargin: "300px" }
    );
    for (const noscript of document.querySelectorAll("noscript")) {
      observer.observe(noscript.parentElement);
    }
  },
};

(function () {
  document.documentElement.classList.add("js");

  const table = document.getElementById("t-orders");
  const query = document.getElementById("q");
  const refusals = document.getElementById("ref");

  // Show the rows that hold every word of the query, and the headings of cases with such a row.
  function filterRows() {
    if (!table) {
      return;
    }
    const words = query.value.match(/"[^"]+"|[^\s"]+/g) ?? [];
    let heading = null;
    let anyShown = false;

    function closeGroup() {
      if (heading) {
        heading.hidden = !anyShown;
      }
    }

    for (const row of table.tBodies[0].rows) {
      if (row.className === "group") {
        closeGroup();
        heading = row;
        anyShown = false;
        continue;
      }
      const text = (row.dataset.case + " " + row.textContent).toLowerCase();
      const names = [row.dataset.case, row.cells[0].textContent];
      // in quotes: the whole name of case or method
      const has = (word) => (word.startsWith('"') ? names.includes(word.slice(1, -1))
        : text.includes(word.toLowerCase()));
      const matches = words.every(has);
      row.hidden = !matches || (!refusals.checked && row.dataset.kind === "refused");
      anyShown = anyShown || !row.hidden;
    }
    closeGroup();
  }

  if (query) {
    query.addEventListener("input", filterRows);
    refusals.addEventListener("change", filterRows);
    // a case leads to its own rows alone, with the filter above them
    for (const link of document.querySelectorAll("a[data-filter]")) {
      link.href = "#q";
      link.addEventListener("click", () => {
        query.value = `"${link.dataset.filter}"`;
        filterRows();
      });
    }
  }

  // On paper nothing can be unfolded.
  addEventListener("beforeprint", function () {
    for (const details of document.querySelectorAll("details")) {
      details.open = true;
    }
    document.querySelectorAll("noscript").forEach(pictures.put);
  });

  pictures.start();

  jump.start();
})();
