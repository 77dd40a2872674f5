// The answer: which method at an error that the reader chooses.
// Costs at every error of the slider were computed when the page was written; here they are
// selected, counted and averaged.
const answer = {
  SHIFT: 1e-3, // seconds added before the logarithm: runs below it count alike
  PAUSE: 50, // milliseconds before the chart is drawn
  waiting: null, // the chart to be drawn
  PENALTY: 10, // an error not reached costs so many times the slowest method that reaches it

  // Seconds of a pair at target k, if they may be compared: a compiled loop that was timed.
  timed(pair, k) {
    const cost = pair.cost[k];
    return cost && pair.loop === "compiled" && cost[0] > 0 ? cost : null;
  },

  // Is a pair the best of its case at target k, by runs that reach the error?
  measured(pair, k) {
    const best = nsbench.data.cases[pair.c].best[k];
    return Boolean(best) && best[0] === pair.m && !best[1];
  },

  // Rank the methods: [{method, reached, cheapest, mean, step, failed, refused, trust}].
  rank(k) {
    const { cases, pairs } = chosen.pairs();
    const best = new Map(); // by case: the cost of the cheapest, and the slowest seconds
    for (const pair of pairs) {
      const cost = answer.timed(pair, k);
      if (cost) {
        const known = best.get(pair.c);
        best.set(pair.c, {
          cost: !known || cost[0] < known.cost[0] ? cost : known.cost,
          method: !known || cost[0] < known.cost[0] ? pair.m : known.method,
          slowest: Math.max(cost[0], known?.slowest ?? 0),
        });
      }
    }
    const rows = new Map();
    for (const pair of pairs) {
      const row = rows.get(pair.m) ?? {
        method: pair.m,
        reached: 0,
        hosted: [], // cases where it reaches the error, but its seconds are not compared
        cheapest: 0,
        ties: 0,
        logs: new Map(),
        steps: [],
        factors: [],
        failed: 0,
        refused: 0,
        tried: 0,
        orders: [],
        errors: [], // least errors of multipliers that have no order, and are they below a floor
        accuracy: pair.accuracy,
        misses: [], // of the cases where it does not reach the error
      };
      rows.set(pair.m, row);
      row.refused += pair.word === "refused" ? 1 : 0;
      row.tried += pair.word === "refused" ? 0 : 1;
      row.failed += pair.good.filter((g, i) => !g && pair.status[i] !== "refused").length;
      if (pair.orders.force?.[4] === "order") {
        row.orders.push(pair.orders.force[0]);
      } else {
        const known = pair.force.filter((error) => error !== null);
        const floor = pair.floors.force ?? 0;
        const least = known.length ? [Math.min(...known)] : [];
        row.errors.push(...least.map((v) => [Math.max(v, floor), v < floor ? "< " : ""]));
      }
      row.reached += pair.cost[k] ? 1 : 0;
      row.misses.push(...(pair.cost[k] ? [] : [pair]));
      row.cheapest += answer.measured(pair, k) ? 1 : 0;
      const cost = answer.timed(pair, k);
      row.hosted.push(...(pair.cost[k] && !cost ? [pair.c] : []));
      if (cost) {
        const first = best.get(pair.c);
        // a tie: the lower quartile is not above the upper quartile of the cheapest
        row.ties += first.method !== pair.m && cost[1] !== null && cost[1] <= first.cost[2] ? 1 : 0;
        row.logs.set(pair.c, Math.log(cost[0] + answer.SHIFT));
        row.factors.push(cost[0] / first.cost[0]);
      }
      row.steps.push(...(pair.cost[k] ? [pair.cost[k][3]] : []));
    }
    for (const row of rows.values()) {
      let sum = 0;
      for (const [c, first] of best) {
        sum += row.logs.get(c) ?? Math.log(answer.PENALTY * first.slowest + answer.SHIFT);
      }
      row.mean = best.size ? Math.exp(sum / best.size) - answer.SHIFT : null;
      row.timed = row.factors.length;
      row.untimed = row.hosted.length;
      row.unmeasured = answer.unmeasured(row, best);
    }
    const order = [...rows.values()].filter((row) => row.tried);
    order.sort((a, b) => (b.timed > 0) - (a.timed > 0) || a.mean - b.mean || b.reached - a.reached);
    const absent = [...rows.values()].filter((row) => !row.tried).map((row) => row.method);
    return { rows: order, best, cases, absent };
  },

  median(values) {
    const sorted = values.filter((v) => v !== null).sort((a, b) => a - b);
    return sorted.length ? sorted[Math.floor((sorted.length - 1) / 2)] : null;
  },

  // Orders of the multipliers; of methods without one, as event location, the largest error.
  multipliers({ orders: values, errors }) {
    if (!values.length && !errors.length) {
      return "no verdict";
    }
    if (!values.length) {
      const [largest, below] = errors.reduce((a, b) => (b[0] > a[0] ? b : a));
      return `no order, errors ${below || "≤ "}${nsbench.format(largest)}`;
    }
    const [low, high] = [Math.min(...values).toFixed(2), Math.max(...values).toFixed(2)];
    return low === high ? `order ${low}` : `order ${low} to ${high}`;
  },

  draw() {
    const k = Number(document.getElementById("answer-error").value);
    const label = nsbench.data.labels[k];
    document.getElementById("answer-label").textContent = label;
    document.getElementById("answer-error").setAttribute("aria-valuetext", `error ${label}`);
    const { rows, best, cases, absent } = answer.rank(k);
    answer.sentence(rows, best, cases, label);
    answer.table(k, rows, cases);
    answer.refusing(absent);
    answer.byCase(k, best, cases);
    // the chart takes longest: it follows when sentence and tables are seen, once in a quick slide
    clearTimeout(answer.waiting);
    answer.waiting = setTimeout(() => answer.profile(k, best, cases), answer.PAUSE);
  },

  sentence(rows, best, cases, label) {
    const target = document.getElementById("answer-sentence");
    const first = rows.find((row) => row.timed);
    if (!cases.length) {
      const { cases: every } = nsbench.data;
      const unknown = chosen.words().filter((word) => !every.some((one) => chosen.has(one, word)));
      const all = unknown.map((word) => `“${word}”`).join(" or ");
      target.textContent = unknown.length ? `No case has ${all}.` : "No case has all of this.";
      return;
    }
    if (cases.length === 1) {
      answer.single(target, cases[0], label);
      return;
    }
    if (!first) {
      target.textContent = `No compiled method reaches an error of ${label} on these cases.`;
      return;
    }
    // the mean is over the cases on which a compiled method reaches the error
    const all = `${cases.length} case${cases.length === 1 ? "" : "s"}`;
    const some = `the ${best.size} of ${all} on which a compiled method reaches it`;
    const over = best.size === cases.length ? all : some;
    const counted = first.unmeasured && ` (with ten times the slowest for ${first.unmeasured})`;
    const winners = rows.filter((row) => row.cheapest).sort((a, b) => b.cheapest - a.cheapest);
    const words = winners.slice(0, 3).flatMap((row, i) => [
      i ? ", " : "",
      nsbench.chip(row.method),
      ` on ${row.cheapest}`,
    ]);
    target.replaceChildren(
      `For an error of ${label} take `,
      nsbench.chip(first.method),
      `: it has the least mean of seconds over ${over}${counted}. Cheapest: `,
      ...words,
      "."
    );
  },

  // The best method on the only case, as on the terminal; the ranking holds the others.
  single(target, c, label) {
    const k = Number(document.getElementById("answer-error").value);
    const best = nsbench.data.cases[c].best[k];
    if (!best) {
      target.textContent = `No method reaches an error of ${label} on this case.`;
      return;
    }
    const chip = nsbench.chip(best[0]);
    if (best[1]) {
      target.replaceChildren(`No run reaches an error of ${label}; best by its order is `, chip,
        `, which ${best[1]}.`);
      return;
    }
    const pair = nsbench.data.pairs.find((one) => one.c === c && one.m === best[0]);
    const setting = answer.setting({ steps: [pair.cost[k][3]], accuracy: pair.accuracy });
    const hosted = pair.loop === "host" ? ", host loop" : "";
    const known = pair.cost[k][0];
    const bound = pair.cost[k][4] ? "≤ " : "";
    const seconds = known === null ? "" : `, ${bound}${nsbench.seconds(known)}${hosted}`;
    target.replaceChildren(`For an error of ${label} the cheapest is `, chip,
      ` (${setting}${seconds}).`);
  },

  table(k, rows, cases) {
    const several = cases.length > 1;
    const named = (pair) => (several ? nsbench.data.cases[pair.c].name : null);
    const body = document.querySelector("#t-answer tbody");
    const least = rows.find((row) => row.timed)?.mean;
    body.replaceChildren(
      ...rows.map((row) => {
        const cell = (text, kind = "number") => nsbench.make("td", { class: kind }, text);
        const tie = row.ties ? ` (+${row.ties} tied)` : "";
        const hosted = nsbench.make("small", {}, `${row.untimed} in a host loop`);
        const untimed = row.untimed ? [hosted] : [];
        const reached = cell(`${row.reached} of ${cases.length}`);
        reached.append(...untimed);
        const failed = cell(String(row.failed));
        failed.append(...row.refused ? [nsbench.make("small", {}, `${row.refused} refused`)] : []);
        const line = nsbench.make("tr", { "data-method": nsbench.data.methods[row.method].name });
        line.append(
          nsbench.make("td", { class: "method" }, explore.chartLink(row.method, null, cases)),
          row.reached ? answer.mean(row, least) : answer.missed(row.misses, k, named),
          reached,
          cell(row.timed || row.cheapest || !row.untimed
            ? `${row.cheapest}${tie}` : "not compared"),
          cell(row.timed ? `× ${nsbench.format(answer.median(row.factors))}`
            : row.reached ? "not compared" : "not reached"),
          cell(row.steps.length ? answer.setting(row) : "not reached"),
          failed,
          cell(answer.multipliers(row))
        );
        return line;
      })
    );
  },

  // Which of the cases of a mean were not measured: "11 of 40 missed"; "" where all were.
  unmeasured({ timed, hosted }, best) {
    const slow = hosted.filter((c) => best.has(c)).length;
    const missed = best.size - timed - slow;
    const all = ` of ${best.size}`;
    const parts = [missed ? [`${missed}${all} missed`] : [],
      slow ? [`${slow}${missed ? "" : all} in a host loop`] : []];
    return parts.flat().join(", ");
  },

  // A cell for the mean of a method, marked where not all of its cases were measured.
  mean(row, least) {
    const marked = row.timed && row.unmeasured;
    const text = row.timed ? `× ${nsbench.format(row.mean / least)}` : "not compared";
    return nsbench.make("td", { class: "number" }, text + (marked ? " *" : ""),
      ...(marked ? [nsbench.make("small", {}, row.unmeasured)] : []));
  },

  // Methods that stand in no row of the table, since they refuse every case in it.
  refusing(methods) {
    const target = document.getElementById("answer-absent");
    target.hidden = !methods.length;
    target.replaceChildren("Refuse all of these cases: ",
      ...methods.flatMap((m, i) => [i ? ", " : "", nsbench.chip(m)]), ".");
  },

  // A cell for an error that none of these pairs reaches: the least error, and the step of the
  // fewest seconds that would reach it. label: the name of a pair, or null.
  missed(pairs, k, label) {
    const name = (pair) => (label(pair) === null ? "" : ` (${label(pair)})`);
    const cell = nsbench.make("td", { class: "quiet missed" });
    const known = pairs.filter((pair) => pair.best !== null).sort((a, b) => a.best - b.best);
    const nearest = known.length ? `best ${nsbench.format(known[0].best)}${name(known[0])}`
      : "no error known";
    cell.append(...answer.unbroken(`not reached; ${nearest}`));
    const rank = (pair) => [pair.loop !== "compiled", pair.needs[k][1]];
    const found = pairs.filter((pair) => pair.needs[k])
      .sort((a, b) => rank(a)[0] - rank(b)[0] || rank(a)[1] - rank(b)[1])[0];
    if (found) {
      const [step, seconds] = found.needs[k];
      const setting = answer.setting({ steps: [step], accuracy: found.accuracy });
      const kind = found.loop === "host" ? "host loop, extrapolated" : "extrapolated";
      const words = `needs ${setting}, about ${nsbench.seconds(seconds)} (${kind})`;
      cell.append(nsbench.make("small", {}, ...answer.unbroken(words + name(found))));
    }
    return cell;
  },

  // The parts of a sentence: no line breaks at the hyphen of 1.1e-15.
  unbroken(sentence) {
    return sentence.split(/(\d[\d.]*e-\d+)/)
      .map((part, i) => (i % 2 ? nsbench.make("span", { class: "n" }, part) : part));
  },

  setting(row) {
    const step = answer.median(row.steps);
    return row.accuracy === "k" ? `k = ${nsbench.format(1 / step)}`
      : `${row.accuracy} = ${nsbench.format(step)}`;
  },

  byCase(k, best, cases) {
    const body = document.querySelector("#t-answer-cases tbody");
    body.replaceChildren(
      ...cases.map((c) => {
        const one = nsbench.data.cases[c];
        const link = nsbench.make("a", { href: `#${one.id}` }, one.name);
        const line = nsbench.make("tr", {}, nsbench.make("td", { class: "method" }, link));
        const chosen = one.best[k];
        const cell = (text) => nsbench.make("td", { class: "number" }, text);
        const own = nsbench.data.pairs.filter((pair) => pair.c === c);
        if (!chosen) {
          const nearest = answer.missed(own, k, (pair) => nsbench.data.methods[pair.m].name);
          nearest.setAttribute("colspan", "5");
          line.append(nearest);
          return line;
        }
        const first = own.find((pair) => pair.m === chosen[0]);
        const trust = cell(first.reason ? `reaction: ${first.trust}` : first.trust);
        trust.append(...(first.reason ? [nsbench.make("small", {}, first.reason)] : []));
        line.append(nsbench.make("td", { class: "best" }, explore.chartLink(first.m, c)));
        if (chosen[1]) {
          line.append(nsbench.make("td", { class: "quiet", colspan: "3" }, chosen[1]), trust);
          return line;
        }
        const compiled = answer.timed(first, k);
        const factors = own.filter((pair) => pair !== first && compiled && answer.timed(pair, k))
          .map((pair) => pair.cost[k][0] / compiled[0]);
        const bound = first.cost[k][4] ? "≤ " : "";
        const row = { steps: [first.cost[k][3]], accuracy: first.accuracy };
        const known = first.cost[k][0] === null ? "not known" : nsbench.seconds(first.cost[k][0]);
        line.append(
          cell(answer.setting(row)),
          cell(`${bound}${known}${first.loop === "compiled" ? "" : " (host loop)"}`),
          cell(factors.length ? `× ${nsbench.format(Math.min(...factors))}` : "none"),
          trust
        );
        return line;
      })
    );
  },

  // Performance profile: share of the cases that a method solves within a factor of the fastest.
  profile(k, best, cases) {
    const rows = [];
    const factors = new Map();
    for (const [c, first] of best) {
      for (const pair of nsbench.data.pairs.filter((p) => p.c === c)) {
        const cost = answer.timed(pair, k);
        if (cost) {
          const list = factors.get(pair.m) ?? [];
          list.push(cost[0] / first.cost[0]);
          factors.set(pair.m, list);
        }
      }
    }
    if (!factors.size) {
      return nsbench.say(document.getElementById("answer-chart"), "Nothing to compare here.");
    }
    const title = document.getElementById("answer-chart-title");
    const all = `${cases.length} case${cases.length === 1 ? "" : "s"}`;
    title.textContent = `Share of ${all} that a compiled method solves to an error of `
      + `${nsbench.data.labels[k]} within a factor of the seconds of the fastest`;
    const largest = 2 * Math.max(2, ...[...factors.values()].flat());
    for (const [m, list] of factors) {
      const method = nsbench.data.methods[m].name;
      list.sort((a, b) => a - b);
      rows.push({ method, x: 1, y: list.filter((f) => f <= 1).length / cases.length });
      list.forEach((x, i) => rows.push({ method, x, y: (i + 1) / cases.length }));
      rows.push({ method, x: largest, y: list.length / cases.length });
    }
    const description =
      "Performance profiles: for each method the share of the cases that it solves within a " +
      "factor of the seconds of the fastest. The table above has the same numbers.";
    const file = `share_of_cases_${nsbench.data.labels[k]}`;
    const usermeta = { file, names: { x: "factor", y: "share" } };
    return nsbench.draw(document.getElementById("answer-chart"),
      nsbench.spec("profile", rows, (s) => Object.assign(s, { usermeta })), description);
  },

  start() {
    const data = nsbench.data;
    const slider = document.getElementById("answer-error");
    slider.max = data.targets.length - 1;
    slider.value = data.default;
    const groups = document.getElementById("answer-group");
    for (const group of new Set(data.cases.map((one) => one.group))) {
      groups.append(nsbench.make("option", { value: group }, group));
    }
    for (const id of ["answer-error", "answer-group", "answer-words"]) {
      document.getElementById(id).addEventListener("input", answer.draw);
    }
    answer.draw();
  },
};
