// Data of the page, and the charts drawn from them.
// The data are JSON, compressed by gzip; every chart is a Vega-Lite layout with rows put in. Vega
// interprets its expressions (ast: true), so that the page needs no eval.
const nsbench = {
  NARROW: 720, // pixels, as in the style sheet: below it legends have fewer columns
  SHORT_NAME: 16, // characters of a method: two such names fit beside each other there
  data: null,

  // Decode the compressed data; resolves to nothing where the browser cannot.
  async load() {
    const element = document.getElementById("payload");
    if (!element || typeof DecompressionStream === "undefined") {
      return null;
    }
    const bytes = Uint8Array.from(atob(element.textContent.trim()), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    nsbench.data = JSON.parse(await new Response(stream).text());
    for (const pair of nsbench.data.pairs) {
      const step = (value) => (value && pair.accuracy === "k" ? 1 / value : value);
      pair.h = pair.asked.map(step);
    }
    return nsbench.data;
  },

  // Make an element with attributes and children (elements or texts).
  make(name, attributes = {}, ...children) {
    const element = document.createElement(name);
    for (const [key, value] of Object.entries(attributes)) {
      element.setAttribute(key, value);
    }
    element.append(...children);
    return element;
  },

  // Format a number as the tables do: 0.012, 3.4e-5.
  format(value) {
    if (value === null || value === undefined) {
      return "none";
    }
    const size = Math.abs(value);
    if (value === 0 || (size >= 0.01 && size < 10000)) {
      return String(Number(value.toPrecision(2)));
    }
    return value.toExponential(1).replace("e+", "e").replace(".0e", "e");
  },

  seconds(value) {
    if (value === null || value === undefined) {
      return "not timed";
    }
    const [scale, unit] = value >= 1 ? [1, "s"] : value >= 1e-3 ? [1e-3, "ms"] : [1e-6, "µs"];
    return `${nsbench.format(value / scale)} ${unit}`;
  },

  // An error bar, [kind, error bar, error, ...], in words; "" without one.
  barText(bar) {
    if (!bar) {
      return "";
    }
    const error = bar[2] === null ? "not known" : nsbench.format(bar[2]);
    return `error bar (${bar[0]}) ${nsbench.format(bar[1])}, error ${error}`;
  },

  // The marker of a method in its colour, as in the static tables.
  chip(method) {
    const known = nsbench.data.methods[method];
    const template = document.querySelector(`#chips [data-method="${method}"]`);
    const label = nsbench.make("span", { class: "m" });
    if (template) {
      label.append(template.cloneNode(true));
    }
    for (const part of known.name.split(/(?<=[_[,])/)) {
      label.append(part, nsbench.make("wbr")); // a line may break there
    }
    return label;
  },

  // Colours of axes and texts from the style sheet, light or dark.
  theme() {
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(`--${name}`).trim();
    return {
      background: null,
      font: style.getPropertyValue("--sans").trim(),
      axis: {
        labelColor: colour("muted"),
        titleColor: colour("muted"),
        gridColor: colour("rule"),
        domainColor: colour("muted"),
        tickColor: colour("muted"),
        labelFontSize: 11.5,
        labelSeparation: 6,
        titleFontSize: 12,
      },
      legend: {
        labelColor: colour("ink"),
        labelFontSize: 12,
        symbolSize: 70,
        // one legend below the other where two do not fit side by side
        layout: { bottom: { direction: innerWidth < nsbench.NARROW ? "vertical" : "horizontal" } },
      },
      view: { stroke: null },
    };
  },

  // The layout `name` with rows put in; change: a function that sets titles.
  spec(name, rows, change = () => {}) {
    const spec = structuredClone(nsbench.data.layouts[name]);
    spec.datasets = { points: rows };
    // Vega warns of a layer without rows
    const kinds = new Set(rows.map((row) => row.kind));
    const kind = (layer) => layer.transform?.[0].filter.equal;
    spec.layer = spec.layer.filter((layer) => !kind(layer) || kinds.has(kind(layer)));
    // error bars are named where some run has one
    const barred = rows.some((row) => row.bar && row.bar !== "none");
    for (const { encoding } of barred ? [] : spec.layer) {
      encoding.tooltip &&= encoding.tooltip.filter((tip) => tip.field !== "bar");
    }
    change(spec);
    nsbench.recolour(spec, new Set(rows.map((row) => row.method)));
    return spec;
  },

  // Use the page's colours of the methods, and only those that have points.
  recolour(spec, used) {
    const style = getComputedStyle(document.documentElement);
    const tones = Object.fromEntries(nsbench.data.methods.map((m) => [m.name, m.tone]));
    const visit = (node) => {
      if (!node || typeof node !== "object") {
        return;
      }
      if (node.field === "method" && node.scale && node.scale.domain) {
        const kept = node.scale.domain.map((name, k) => [name, node.scale.range[k]]);
        const shown = kept.filter(([name]) => used.has(name));
        const coloured = typeof shown[0]?.[1] === "string" && shown[0][1].startsWith("#");
        node.scale.domain = shown.map(([name]) => name);
        if (node.legend) {
          const hasLong = shown.some(([name]) => name.length > nsbench.SHORT_NAME);
          node.legend.columns = innerWidth < nsbench.NARROW ? (hasLong ? 1 : 2) : 4;
        }
        node.scale.range = shown.map(([name, value]) =>
          coloured ? style.getPropertyValue(`--m${tones[name]}`).trim() : value
        );
      }
      Object.values(node).forEach(visit);
    };
    visit(spec.layer);
  },

  drawn: new Map(),

  // Draw a chart into an element; a description is what a screen reader says.
  async draw(element, spec, description) {
    element.setAttribute("role", "img");
    element.setAttribute("aria-label", description);
    nsbench.drawn.get(element)?.result?.finalize();
    nsbench.drawn.set(element, { spec, description });
    const result = await vegaEmbed(element, spec, {
      ast: true,
      actions: false,
      defaultStyle: false,
      renderer: "canvas",
      config: nsbench.theme(),
      tooltip: { disableDefaultStyle: true, theme: "page" },
    });
    element.dataset.drawn = "yes";
    nsbench.drawn.set(element, { spec, description, result });
    save.offer(element);
    return result;
  },

  // Say in place of a chart that there is nothing to draw.
  say(element, sentence) {
    nsbench.drawn.get(element)?.result?.finalize();
    nsbench.drawn.delete(element);
    save.withdraw(element);
    element.replaceChildren(nsbench.make("p", { class: "note" }, sentence));
    element.dataset.drawn = "empty";
  },

  // Call `draw` once when the element comes near the screen; returns what draws it at once instead.
  whenSeen(element, draw) {
    const observer = new IntersectionObserver(
      (entries) => {
        if (entries.some((entry) => entry.isIntersecting)) {
          observer.disconnect();
          draw();
        }
      },
      { rootMargin: "300px" }
    );
    observer.observe(element);
    return () => {
      observer.disconnect();
      return draw();
    };
  },

  // Rows of an error chart for some pairs: y is a column of errors, x a column of steps or costs.
  errorRows(pairs, y, x) {
    const rows = [];
    const methods = nsbench.data.methods;
    for (const pair of pairs) {
      const method = methods[pair.m].name;
      const together = (k) => nsbench.together(pair, `${y}/${x}`, k);
      if (x === "h" && pair.accuracy === "tol") {
        const found = pair[y].map((error, k) => (pair.good[k] && error > 0 ? error : Infinity));
        const least = Math.min(...found);
        if (least < Infinity) {
          const at = found.indexOf(least);
          const bar = nsbench.barText(pair.bars[y]?.[at]) || "none";
          const level = { method, methods: together(at), kind: "level", y: least };
          rows.push({ ...level, status: "ok", bar });
        }
        continue;
      }
      pair.status.forEach((status, k) => {
        const at = pair[x][k];
        const error = pair[y][k];
        if (!(at > 0)) {
          return;
        }
        const bar = nsbench.barText(pair.bars[y]?.[k]) || "none";
        const named = { method, methods: together(k), status, bar };
        const row = { ...named, x: at, h: pair.h[k], seconds: pair.seconds[k] };
        if (pair.good[k] && error !== null) {
          rows.push({ ...row, y: error, kind: error > 0 ? "error" : "zero" });
        } else if (!pair.good[k] && status !== "refused") {
          rows.push({ ...row, kind: "failed", why: pair.why || status });
        }
      });
    }
    const floor = Math.max(0, ...pairs.map((pair) => (pair.floors[y] || 0)));
    const errors = rows.filter((row) => ["error", "level"].includes(row.kind)).map((row) => row.y);
    if (floor > 0 && errors.length) {
      const label = `error of the reference, at most ${nsbench.format(floor)}`;
      const inView = floor * nsbench.data.reach >= Math.min(...errors);
      rows.push({ kind: inView ? "floor" : "far_floor", y: floor, label });
    }
    return rows;
  },

  // The names of all methods whose marks lie where that of run k of a pair does.
  together(pair, chart, k) {
    const { methods, groups } = nsbench.data;
    const group = groups[pair.together[chart]?.[k] ?? -1] ?? [pair.m];
    return group.map((m) => methods[m].name).join(", ");
  },
};
