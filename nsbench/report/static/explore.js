// One interactive figure of any case, the scatter of two methods, orders, and a figure per case.
const explore = {
  METRICS: {
    state: "state error",
    force: "error of the multipliers (impulse, or reaction where they are not unique)",
    violation: "violation max(-g)",
    selection: "selection of the multipliers (not an error)",
  },
  COSTS: {
    h: null, // the title comes with the data
    seconds: "seconds of the run",
    rhs: "drift calls",
    inner: "projections + inner iterations",
  },

  options(select, names) {
    for (const [value, text] of names) {
      select.append(nsbench.make("option", { value }, text));
    }
  },

  // A figure of errors with two selects above; c: a function that returns the case.
  errorFigure(chart, metric, cost, c) {
    const titles = { ...explore.COSTS, h: nsbench.data.step };
    const short = { h: "step", seconds: "seconds", rhs: "drift calls", inner: "inner work" };
    explore.options(metric, Object.entries(explore.METRICS).map(([k, t]) => [k, t.split(" (")[0]]));
    explore.options(cost, Object.entries(short));
    const draw = () => {
      const pairs = nsbench.data.pairs.filter((p) => p.c === c() && p.word !== "refused");
      const rows = nsbench.errorRows(pairs, metric.value, cost.value);
      const name = nsbench.data.cases[c()].name;
      if (!rows.some((row) => row.kind === "error")) {
        return nsbench.say(chart, `No run of ${name} with a step has a number above 0 here.`);
      }
      const { columns } = nsbench.data;
      const force = pairs[0].metric;
      const spec = nsbench.spec("error", rows, (s) => {
        s.usermeta = {
          file: `${name}_${metric.value}_${cost.value}`,
          names: { x: columns[cost.value], y: columns[metric.value] ?? force },
          every: { case: name },
        };
        for (const layer of s.layer) {
          layer.encoding.x && (layer.encoding.x.title = titles[cost.value]);
          layer.encoding.y?.field && (layer.encoding.y.title = explore.METRICS[metric.value]);
        }
      });
      const description =
        `${explore.METRICS[metric.value]} of ${name} over ${titles[cost.value]}, one line for ` +
        "each method; the tables of this page hold the numbers.";
      return nsbench.draw(chart, spec, description);
    };
    metric.addEventListener("input", draw);
    cost.addEventListener("input", draw);
    return draw;
  },

  startErrors() {
    const chart = document.getElementById("explore-chart");
    const cases = document.getElementById("explore-case");
    const cost = document.getElementById("explore-cost");
    explore.options(cases, nsbench.data.cases.map((one, k) => [k, one.name]));
    const talked = nsbench.data.cases.findIndex((one) => one.name.startsWith("discs[n=30"));
    cases.value = Math.max(talked, 0);
    const metric = document.getElementById("explore-metric");
    const draw = explore.errorFigure(chart, metric, cost, () => Number(cases.value));
    cost.value = "seconds";
    cases.addEventListener("input", draw);
    explore.drawn = nsbench.whenSeen(chart, draw);
  },

  // A link to the work-precision chart of case c with method m picked there. Without a case: that
  // of the chart, or the first of `cases` on which the method ran.
  chartLink(m, c, cases = [c]) {
    const link = nsbench.make("a", { href: "#explore" }, nsbench.chip(m));
    link.title = "its work-precision chart";
    link.addEventListener("click", () => {
      const select = document.getElementById("explore-case");
      const ran = (k) => nsbench.data.pairs.some(
        (pair) => pair.c === k && pair.m === m && pair.word !== "refused");
      select.value = c ?? [Number(select.value), ...cases].find(ran) ?? select.value;
      document.getElementById("explore-metric").value = "state";
      document.getElementById("explore-cost").value = "seconds";
      explore.pick(m);
    });
    return link;
  },

  // Draw the chart of errors again with one method picked, the others greyed.
  async pick(m) {
    const result = await explore.drawn();
    const name = nsbench.data.methods[m].name;
    result?.view.signal("pick_method_legend", name).run();
  },

  startScatter() {
    const chart = document.getElementById("scatter-chart");
    const [one, other] = ["scatter-x", "scatter-y"].map((id) => document.getElementById(id));
    const names = nsbench.data.methods.map((m, k) => [k, m.name]);
    explore.options(one, names);
    explore.options(other, names);
    const find = (name) => nsbench.data.methods.findIndex((m) => m.name === name);
    one.value = Math.max(find("pbd"), 0);
    other.value = find("catching_up") >= 0 ? find("catching_up") : Math.min(1, names.length - 1);
    const slider = document.getElementById("answer-error");
    const draw = () => {
      const k = Number(slider.value);
      const [a, b] = [Number(one.value), Number(other.value)];
      const rows = [];
      nsbench.data.cases.forEach((known, c) => {
        const cost = (m) => {
          const pair = nsbench.data.pairs.find((p) => p.c === c && p.m === m);
          return pair && answer.timed(pair, k);
        };
        const [x, y] = [cost(a), cost(b)];
        if (x && y) {
          rows.push({ kind: "case", case: known.name, group: known.group, x: x[0], y: y[0] });
        }
      });
      const note = document.getElementById("scatter-note");
      const label = nsbench.data.labels[k];
      note.textContent = `${rows.length} cases on which both reach an error of ${label}; ` +
        `above the line ${names[a][1]} is faster.`;
      if (!rows.length) {
        return nsbench.say(chart, note.textContent);
      }
      const all = rows.flatMap((row) => [row.x, row.y]);
      for (const end of all.length ? [Math.min(...all), Math.max(...all)] : []) {
        rows.push({ kind: "equal", x: end, y: end });
      }
      const spec = nsbench.spec("scatter", rows, (s) => {
        const [x, y] = [a, b].map((m) => `seconds of ${names[m][1]}`);
        s.usermeta = { file: `seconds_${label}`, names: { x, y, group: "problem" } };
        for (const layer of s.layer) {
          layer.encoding.x.title = `seconds of ${names[a][1]}`;
          layer.encoding.y.title = `seconds of ${names[b][1]}`;
        }
      });
      return nsbench.draw(chart, spec, note.textContent);
    };
    for (const element of [one, other, slider]) {
      element.addEventListener("input", () => chart.dataset.drawn && draw());
    }
    nsbench.whenSeen(chart, draw);
  },

  // Error bars over errors; a point below the line is a bar that is too small.
  startBars() {
    const chart = document.getElementById("bars-chart");
    const metric = document.getElementById("bars-metric");
    if (!chart) {
      return; // no run has an error bar
    }
    const draw = () => {
      const rows = [];
      for (const pair of nsbench.data.pairs) {
        const named = { method: nsbench.data.methods[pair.m].name };
        named.case = nsbench.data.cases[pair.c].name;
        (pair.bars[metric.value] ?? []).forEach((bar, k) => {
          if (bar?.[3] && bar[1] > 0) {
            rows.push({ kind: "run", ...named, h: pair.h[k], bar: bar[0], x: bar[2], y: bar[1] });
          }
        });
      }
      const what = metric.selectedOptions[0].textContent;
      if (!rows.length) {
        return nsbench.say(chart, `No run has both an error and an error bar of the ${what}.`);
      }
      const all = rows.flatMap((row) => [row.x, row.y]);
      for (const end of [Math.min(...all), Math.max(...all)]) {
        rows.push({ kind: "equal", x: end, y: end });
      }
      const norm = metric.value === "state" ? "state_norm" : "reaction_norm";
      const usermeta = { file: `error_bars_${what}`, names: { x: norm, y: "error_bar" } };
      return nsbench.draw(chart, nsbench.spec("bars", rows, (s) => Object.assign(s, { usermeta })),
        `Error bars of the ${what} over the errors of the same runs, one point for each run.`);
    };
    metric.addEventListener("input", draw);
    nsbench.whenSeen(chart, draw);
  },

  startOrders() {
    const chart = document.getElementById("orders-chart");
    const metric = document.getElementById("orders-metric");
    const draw = () => {
      const rows = nsbench.data.pairs
        .filter((pair) => pair.orders[metric.value])
        .map((pair) => {
          const [x, low, high, , verdict] = pair.orders[metric.value];
          const names = nsbench.data;
          const [method, name] = [names.methods[pair.m].name, names.cases[pair.c].name];
          return { method, case: name, x, low, high, verdict };
        });
      const what = metric.selectedOptions[0].textContent;
      if (!rows.length) {
        return nsbench.say(chart, `No order of the ${what} could be fitted.`);
      }
      const usermeta = { file: `orders_${what}`, names: { x: "order" } };
      return nsbench.draw(chart, nsbench.spec("order", rows, (s) => Object.assign(s, { usermeta })),
        `Orders of convergence of the ${what} with their 95 % intervals, by case and method.`);
    };
    metric.addEventListener("input", draw);
    nsbench.whenSeen(chart, draw);
  },

  // The figure and the table of runs of every case, made when they come near the screen.
  startCases() {
    nsbench.data.cases.forEach((known, c) => {
      const article = document.getElementById(known.id);
      const place = article?.querySelector(".live");
      if (!place) {
        return;
      }
      const runs = explore.runs(c, `runs-${known.id}`);
      place.append(runs);
      nsbench.whenSeen(place, () => {
        const metric = nsbench.make("select", { "aria-label": "quantity" });
        const cost = nsbench.make("select", { "aria-label": "against" });
        const chart = nsbench.make("div", { class: "chart" });
        runs.before(nsbench.make("p", { class: "tools" }, metric, " against ", cost), chart);
        explore.errorFigure(chart, metric, cost, () => c)();
      });
    });
  },

  // All runs of a case as a table, filled when it is opened.
  runs(c, id) {
    const summary = nsbench.make("summary", {}, "All runs");
    const details = nsbench.make("details", { class: "fits", id }, summary);
    details.addEventListener("toggle", () => {
      if (details.querySelector("table")) {
        return;
      }
      const pairs = nsbench.data.pairs.filter((p) => p.c === c);
      const barred = pairs.some((pair) => pair.bars.state);
      const heads = ["method", "step, 1/k or tol", "status", "state error", "multiplier error",
        "violation", "seconds", ...(barred ? ["in the 2-norm"] : [])];
      const body = nsbench.make("tbody");
      for (const pair of pairs) {
        pair.status.forEach((status, k) => {
          const part = explore.part(pair.violation[k], nsbench.data.cases[c].length);
          const texts = [status, explore.error(pair.state[k], pair.floors.state),
            explore.error(pair.force[k], pair.floors.force), nsbench.format(pair.violation[k])];
          const cells = [explore.step(pair, k), ...texts.map((text) => [text])]
            .map((parts) => nsbench.make("td", { class: "number" }, ...parts));
          cells.at(-1).append(...(part ? [nsbench.make("small", {}, part)] : []));
          cells.push(nsbench.make("td", { class: "number" }, nsbench.seconds(pair.seconds[k])));
          const bar = nsbench.barText(pair.bars.state?.[k]);
          if (barred) {
            cells.push(nsbench.make("td", bar ? {} : { class: "quiet" }, bar || "no error bar"));
          }
          body.append(nsbench.make("tr", {},
            nsbench.make("td", { class: "method" }, nsbench.chip(pair.m)), ...cells));
        });
      }
      const head = nsbench.make("tr", {},
        ...heads.map((h) => nsbench.make("th", { scope: "col" }, h)));
      const table = nsbench.make("table", {}, nsbench.make("thead", {}, head), body);
      details.append(explore.inFull(table),
        nsbench.make("div", { class: "wrap", tabindex: "0" }, table));
    });
    return details;
  },

  // What a cell says of the step of run k: rounded for the eye; in full, to repeat the run, for
  // pointers, screen readers and, with the box of inFull ticked, everybody.
  step(pair, k) {
    const rounded = nsbench.format(pair.h[k]);
    if (pair.asked[k] === null) {
      return [rounded];
    }
    const full = `${pair.accuracy} = ${pair.asked[k]}`;
    return [
      nsbench.make("span", { class: "rounded", "aria-hidden": "true", title: full }, rounded),
      nsbench.make("span", { class: "full" }, full),
    ];
  },

  // A box that shows the steps of a table in full.
  inFull(table) {
    const box = nsbench.make("input", { type: "checkbox" });
    box.addEventListener("change", () => table.classList.toggle("in-full", box.checked));
    return nsbench.make("p", { class: "tools" }, nsbench.make("label", {}, box, " steps in full"));
  },

  // An error, or the floor of its reference: what lies below it is not known.
  error(value, floor) {
    return value !== null && value < floor ? `< ${nsbench.format(floor)}` : nsbench.format(value);
  },

  // A violation in per cent of the length that its case has of its own; "" without one.
  part(violation, length) {
    const known = length && violation !== null;
    return known ? `${nsbench.format((100 * violation) / length)} %` : "";
  },

  // Left and right arrow go from case to case.
  startKeys() {
    const ids = nsbench.data.cases.map((one) => one.id);
    let at = null; // the case that the keys went to; forgotten when the reader scrolls
    for (const kind of ["wheel", "touchmove", "mousedown"]) {
      addEventListener(kind, () => { at = null; }, { passive: true });
    }
    addEventListener("keydown", (event) => {
      const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
      const busy = event.target.closest?.("input, select, textarea, [role=slider], .player");
      if (!step || busy || event.ctrlKey || event.metaKey || event.altKey) {
        return;
      }
      const tops = ids.map((id) => document.getElementById(id)?.getBoundingClientRect().top ?? NaN);
      const current = at ?? tops.findLastIndex((top) => top <= 80);
      at = Math.min(Math.max(current + step, 0), ids.length - 1);
      history.replaceState(null, "", `#${ids[at]}`);
      jump.to(ids[at]);
      event.preventDefault();
    });
  },
};
