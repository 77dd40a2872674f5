// Players: two runs of a case beside each other, with the reference as a grey ghost.
// The frames are packed in the page (nsbench/report/scenes/player.py says what they hold); a player
// is made when it comes near the screen, and stands still while it is out of sight.
const player = {
  SECONDS: 6, // of a whole run
  SHOWN: 5, // multipliers in a panel, those with the largest impulses
  TOUCH: 2e-3, // of a diameter: discs that overlap by more are red
  all: new Set(),

  startAll() {
    if (typeof DecompressionStream === "undefined") {
      return;
    }
    if (!document.getElementById("payload") && document.querySelector(".player")) {
      document.documentElement.classList.add("live-page");
    }
    for (const element of document.querySelectorAll(".player")) {
      nsbench.whenSeen(element, () => player.start(element));
    }
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () =>
      player.all.forEach((one) => one.draw())
    );
  },

  async start(element) {
    const text = element.querySelector("script").textContent.trim();
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    try {
      const data = player.unpack(JSON.parse(await new Response(stream).text()));
      player.all.add(new Player(element, data));
    } catch (error) {
      element.append(nsbench.make("p", { class: "note" }, `No moving scene: ${error.message}`));
    }
    element.dataset.ready = "yes";
  },

  // Sum the differences; states become arrays of coordinates, multipliers numbers by frame.
  unpack(data) {
    const sum = (unit) => (row) => {
      let total = 0;
      return row.map((step) => (total += step) * unit);
    };
    data.ghost = data.reference?.map(sum(data.unit));
    for (const run of data.runs) {
      run.x = run.states.map(sum(data.unit));
      run.end = run.x.length ? run.x[0].length - 1 : -1;
      run.lambda = run.lam.map(sum(data.lam_unit));
      const weight = run.lambda.map((row) => row.reduce((a, b) => a + b, 0));
      run.largest = weight.map((_, k) => k).sort((a, b) => weight[b] - weight[a]);
    }
    const values = data.runs.flatMap((run) => run.lambda.flat());
    data.top = Math.max(...values, 0) || 1;
    if (data.kind === "curves") {
      const shown = [...(data.ghost ?? []), ...data.runs.flatMap((run) => run.x)].flat();
      const [low, high] = [Math.min(...shown), Math.max(...shown)];
      const pad = 0.06 * (high - low) || 1;
      data.box = [data.t[0], data.t.at(-1), low - pad, high + pad];
    }
    return data;
  },

  // Coordinates at a time between two frames.
  at(columns, f) {
    const k = Math.floor(f);
    const share = f - k;
    return columns.map((x) => x[k] + (share ? share * (x[k + 1] - x[k]) : 0));
  },

  colours() {
    const style = getComputedStyle(document.documentElement);
    const read = (name) => style.getPropertyValue(`--${name}`).trim();
    const names = ["ink", "muted", "rule", "shade", "bad", "paper"];
    return {
      ...Object.fromEntries(names.map((name) => [name, read(name)])),
      ghost: `color-mix(in srgb, ${read("muted")} 55%, ${read("paper")})`,
      tones: [0, 1, 2, 3, 4, 5].map((k) => read(`m${k}`)),
    };
  },
};

// One player: controls, and a view for each of the two runs that are shown.
class Player {
  constructor(element, data) {
    this.data = data;
    this.f = 0;
    this.last = data.t.length - 1;
    this.pair = this.sameStep();
    this.build(element);
    this.seen = new IntersectionObserver((entries) => {
      this.visible = entries.at(-1).isIntersecting;
      this.visible || this.play(false);
    });
    this.seen.observe(element);
    new ResizeObserver(() => this.draw()).observe(element);
    this.draw();
  }

  // The coarsest run of each method.
  sameStep() {
    const first = (solver) => this.data.runs.findIndex((run) => run.solver === solver);
    const solvers = [...new Set(this.data.runs.map((run) => run.solver))];
    return solvers.slice(0, 2).map(first);
  }

  build(element) {
    const { make } = nsbench;
    this.button = make("button", { type: "button", class: "play" }, "Play");
    const range = { type: "range", min: 0, max: this.last, step: 1, value: 0 };
    this.scrub = make("input", { ...range, "aria-label": "time" });
    this.time = make("output", {});
    const controls = make("div", { class: "controls" }, this.button, this.scrub, this.time);
    if (this.data.budget) {
      this.budget = make("input", { type: "checkbox", class: "budget" });
      controls.append(make("label", {}, this.budget, " same budget"));
      this.budget.addEventListener("change", () => {
        this.show(this.budget.checked ? [...this.data.budget] : this.sameStep());
      });
    }
    this.views = this.pair.map((_, k) => this.view(k));
    const views = make("div", { class: "views" }, ...this.views.map((view) => view.element));
    element.append(controls, views);
    this.button.addEventListener("click", () => this.play(!this.playing));
    this.scrub.addEventListener("input", () => {
      this.play(false);
      this.f = Number(this.scrub.value);
      this.draw();
    });
  }

  view(k) {
    const { make } = nsbench;
    const select = make("select", { "aria-label": "run" });
    this.data.runs.forEach((run, value) => {
      select.append(make("option", { value }, this.label(run)));
    });
    const [x0, x1, y0, y1] = this.data.box;
    const flat = this.data.kind === "particles" && y1 - y0 < 0.3 * (x1 - x0) ? " flat" : "";
    const scene = make("canvas", { class: `frame${flat}`, role: "img" });
    const lambda = make("canvas", { class: "multipliers", role: "img" });
    const caption = make("p", { class: "note" });
    select.addEventListener("change", () => {
      this.budget && (this.budget.checked = false);
      this.pair[k] = Number(select.value);
      this.draw();
    });
    const element = make("div", {}, select, scene, lambda, caption);
    return { element, select, scene, lambda, caption };
  }

  label(run) {
    const value = nsbench.format(run.accuracy === "k" ? run.asked : run.h ?? run.asked);
    const seconds = run.seconds ? `, ${nsbench.seconds(run.seconds)}` : "";
    return `${run.solver}, ${run.accuracy} = ${value}${seconds}`;
  }

  show(pair) {
    this.pair = pair;
    this.draw();
  }

  play(on) {
    this.playing = on;
    this.button.textContent = on ? "Pause" : "Play";
    if (!on) {
      return;
    }
    if (this.f >= this.last) {
      this.f = 0;
    }
    let before = null;
    const tick = (now) => {
      if (!this.playing) {
        return;
      }
      const passed = before === null ? 0 : (now - before) / 1000;
      before = now;
      this.f = Math.min(this.last, this.f + (passed * this.last) / player.SECONDS);
      this.scrub.value = Math.round(this.f);
      this.draw();
      this.f < this.last ? requestAnimationFrame(tick) : this.play(false);
    };
    requestAnimationFrame(tick);
  }

  draw() {
    const colour = player.colours();
    const time = `t = ${Number(player.at([this.data.t], this.f)[0].toPrecision(3))}`;
    this.time.textContent = time;
    this.scrub.setAttribute("aria-valuetext", time);
    this.views.forEach((view, k) => {
      const run = this.data.runs[this.pair[k]];
      view.select.value = this.pair[k];
      if (view.scene.clientWidth) {
        this.drawScene(view, run, colour);
        this.drawMultipliers(view, run, colour);
      }
    });
  }

  drawScene(view, run, colour) {
    const { data } = this;
    const ends = run.end < 0 ? `No state: ${run.why || run.status}` : `The run ended: ${run.why}`;
    const f = Math.min(this.f, run.end);
    const plot = new Plot(view.scene, data.box, data.kind !== "curves", 6);
    if (run.end >= 0) {
      scenes[data.kind](plot, data, run, f, colour);
    }
    const frame = Math.round(f);
    const number = (column) => column[frame] ?? null;
    const parts = [["error", run.error], ["violation", run.violation]]
      .filter(([, column]) => number(column) !== null)
      .map(([name, column]) => `${name} ${nsbench.format(number(column))}`);
    view.caption.textContent = this.f > run.end ? ends : parts.join(" · ");
    view.caption.classList.toggle("bad", this.f > run.end);
    view.scene.setAttribute("aria-label", `${this.label(run)}: ${view.caption.textContent}`);
  }

  drawMultipliers(view, run, colour) {
    const { data } = this;
    const { t } = data;
    const box = [t[0], t.at(-1), -0.04 * data.top, 1.25 * data.top];
    const plot = new Plot(view.lambda, box, false, 6);
    const name = data.lines?.length ? "θ(t)" : "λ(t)";
    const shown = run.largest.slice(0, player.SHOWN);
    plot.line([[box[0], 0], [box[1], 0]], colour.rule, 1);
    shown.forEach((k, place) => {
      const row = run.lambda[k];
      const steps = row.flatMap((v, i) => (i ? [[t[i - 1], v], [t[i], v]] : []));
      plot.line(steps, colour.tones[place % colour.tones.length], 1.3);
    });
    const time = player.at([t], this.f)[0];
    plot.line([[time, box[2]], [time, box[3]]], colour.muted, 1, [2, 3]);
    const count = run.lambda.length;
    const which = count > shown.length ? `, the ${shown.length} largest of ${count}` : "";
    const all = `${name}${which}, up to ${nsbench.format(data.top)}`;
    const words = count ? all : "no multiplier acts";
    plot.text(words, 8, 14, colour.muted);
    view.lambda.setAttribute("aria-label", words);
  }
}
