// Drawing of one state of a case on a canvas: particles, a point in the plane, curves over time.

// A canvas with coordinates of the case: y grows upwards.
class Plot {
  constructor(canvas, box, equal, margin) {
    const ratio = window.devicePixelRatio || 1;
    this.width = canvas.clientWidth;
    this.height = canvas.clientHeight;
    canvas.width = Math.round(this.width * ratio);
    canvas.height = Math.round(this.height * ratio);
    this.pen = canvas.getContext("2d");
    this.pen.scale(ratio, ratio);
    this.box = box;
    this.sx = (this.width - 2 * margin) / (box[1] - box[0]);
    this.sy = (this.height - 2 * margin) / (box[3] - box[2]);
    if (equal) {
      this.sx = this.sy = Math.min(this.sx, this.sy);
    }
    this.cx = this.width / 2;
    this.cy = this.height / 2;
  }

  x(v) {
    return this.cx + this.sx * (v - (this.box[0] + this.box[1]) / 2);
  }

  y(v) {
    return this.cy - this.sy * (v - (this.box[2] + this.box[3]) / 2);
  }

  line(points, colour, width = 1, dash = []) {
    this.pen.beginPath();
    points.forEach(([a, b], k) => this.pen[k ? "lineTo" : "moveTo"](this.x(a), this.y(b)));
    this.pen.strokeStyle = colour;
    this.pen.lineWidth = width;
    this.pen.setLineDash(dash);
    this.pen.stroke();
    this.pen.setLineDash([]);
  }

  fill(polygons, colour) {
    this.pen.beginPath();
    for (const points of polygons) {
      points.forEach(([a, b], k) => this.pen[k ? "lineTo" : "moveTo"](this.x(a), this.y(b)));
    }
    this.pen.fillStyle = colour;
    this.pen.fill("evenodd");
  }

  // A disc; a radius of 0 is a dot of `dot` pixels.
  disc(a, b, radius, stroke, fill, width = 1, dot = 3) {
    this.pen.beginPath();
    this.pen.arc(this.x(a), this.y(b), radius ? radius * this.sx : dot, 0, 2 * Math.PI);
    if (fill) {
      this.pen.globalAlpha = radius ? 0.28 : 1;
      this.pen.fillStyle = fill;
      this.pen.fill();
      this.pen.globalAlpha = 1;
    }
    this.pen.strokeStyle = stroke;
    this.pen.lineWidth = width;
    this.pen.stroke();
  }

  text(words, x, y, colour, align = "left") {
    this.pen.font = "11.5px system-ui, sans-serif";
    this.pen.textAlign = align;
    this.pen.fillStyle = colour;
    this.pen.fillText(words, x, y);
  }
}

// How a state is drawn, by the kind of the case: (plot, data, run, f, colours).
const scenes = {
  particles(plot, data, run, f, colour) {
    const size = Math.max(data.box[1] - data.box[0], data.box[3] - data.box[2]) * 2;
    for (const [a, b, c] of data.walls) {
      const foot = [-c * a, -c * b];
      const ends = [size, -size].map((s) => [foot[0] - s * b, foot[1] + s * a]);
      const behind = ends.map(([x, y]) => [x - size * a, y - size * b]).reverse();
      plot.fill([[...ends, ...behind]], colour.shade);
      plot.line(ends, colour.muted, 1);
    }
    if (data.ghost) {
      scenes.centres(data, player.at(data.ghost, f)).forEach((group) =>
        group.forEach(([x, y, r]) => plot.disc(x, y, r, colour.ghost, null, 1.4, 4))
      );
    }
    const groups = scenes.centres(data, player.at(run.x, f));
    // between two frames discs move on straight lines: overlaps are those of a frame
    const frame = Math.min(Math.round(f), run.end);
    const stored = scenes.centres(data, player.at(run.x, frame));
    const overlaps = stored.map((group) => scenes.overlaps(group, 3 * data.unit));
    groups.forEach((group, g) =>
      group.forEach(([x, y, r], i) => {
        const tone = overlaps[g].has(i) ? colour.bad : colour.tones[0];
        plot.disc(x, y, r, tone, tone, 1.2);
      })
    );
    for (const [g, i, j] of data.links) {
      plot.line([groups[g][i], groups[g][j]], colour.muted, 1);
    }
    for (const [g, i, x, y] of data.fixed) {
      plot.line([groups[g][i], [x, y]], colour.muted, 1);
      plot.disc(x, y, 0, colour.ink, colour.ink, 1, 3);
    }
    run.contacts.forEach((contact, k) => {
      const load = run.lambda[k][frame] / data.top;
      const from = groups[contact.g]?.[contact.i];
      if (load > 0.004 && from) {
        const [x, y, r] = from;
        const [nx, ny] = contact.n ?? [0, 0];
        const wall = contact.n && [x + nx * r, y + ny * r];
        const end = contact.to ?? wall ?? groups[contact.g][contact.j];
        plot.line([from, end], colour.tones[1], 1 + 6 * load);
      }
    });
  },

  // Centres with radii of all groups: [[x, y, r], ...] each.
  centres(data, x) {
    return data.groups.map(({ start, dim, count, radius }) =>
      Array.from({ length: count }, (_, i) => {
        const place = start + i * dim;
        const r = radius ? radius[radius.length > 1 ? i : 0] : 0;
        return [x[place], dim > 1 ? x[place + 1] : 0, r];
      })
    );
  },

  // Discs that overlap another one by more than TOUCH of their distance, and than `least`.
  overlaps(group, least) {
    const out = new Set();
    group.forEach(([x, y, r], i) => {
      for (let j = 0; r && j < i; j += 1) {
        const touch = r + group[j][2];
        const depth = touch - Math.hypot(x - group[j][0], y - group[j][1]);
        if (depth > Math.max(touch * player.TOUCH, least)) {
          out.add(i).add(j);
        }
      }
    });
    return out;
  },

  plane(plot, data, run, f, colour) {
    plot.fill(data.region, colour.shade);
    data.region.forEach((polygon) => plot.line([...polygon, polygon[0]], colour.rule, 1));
    const size = 0.032 * (data.box[1] - data.box[0]);
    for (const [x, y, u, v] of data.arrows) {
      const tip = [x + size * u, y + size * v];
      const barb = (side) => [
        tip[0] - 0.45 * size * (u + side * v),
        tip[1] - 0.45 * size * (v - side * u),
      ];
      plot.line([[x - size * u, y - size * v], tip], colour.rule, 1);
      plot.line([barb(0.6), tip, barb(-0.6)], colour.rule, 1);
    }
    data.lines.forEach((line) => plot.line(line, colour.ink, 1.4));
    const path = (x, end) => x[0].slice(0, end).map((v, k) => [v, x[1][k]]);
    if (data.ghost) {
      plot.line(path(data.ghost), colour.ghost, 4);
      const [x, y] = player.at(data.ghost, f);
      plot.disc(x, y, 0, colour.ghost, null, 2, 7);
    }
    const now = player.at(run.x, f);
    const violated = run.violation[Math.round(f)] > 2 * data.unit;
    plot.line([...path(run.x, Math.floor(f) + 1), now], colour.tones[0], 1.8);
    const tone = violated ? colour.bad : colour.tones[0];
    plot.disc(now[0], now[1], 0, tone, tone, 1, 4.5);
  },

  curves(plot, data, run, f, colour) {
    const points = (x, end) => x.slice(0, end).map((v, k) => [data.t[k], v]);
    const zero = [[data.box[0], 0], [data.box[1], 0]];
    if (data.box[2] < 0 && data.box[3] > 0) {
      plot.line(zero, colour.rule, 1);
    }
    data.ghost?.forEach((x) => plot.line(points(x), colour.ghost, 4));
    const time = player.at([data.t], f)[0];
    const now = player.at(run.x, f);
    run.x.forEach((x, k) => {
      const tone = colour.tones[k % colour.tones.length];
      plot.line([...points(x, Math.floor(f) + 1), [time, now[k]]], tone, 1.6);
      plot.disc(time, now[k], 0, tone, tone, 1, 3.2);
    });
    plot.line([[time, data.box[2]], [time, data.box[3]]], colour.muted, 1, [2, 3]);
  },
};
