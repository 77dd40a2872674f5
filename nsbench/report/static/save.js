// Buttons below each chart: its data as CSV, and the chart as drawn as SVG. Both are made in the
// page and saved from a blob: nothing is fetched.
const save = {
  OMITTED: ["label", "methods"], // of the rows: words of a legend and of a tooltip

  // Put the buttons below a chart, once.
  offer(element) {
    if (element.nextElementSibling?.classList.contains("save")) {
      element.nextElementSibling.hidden = false;
      return;
    }
    const bar = nsbench.make("p", { class: "save" });
    const kinds = [
      ["CSV", "text/csv;charset=utf-8", save.table, "the data of this chart as CSV"],
      ["SVG", "image/svg+xml", save.picture, "this chart as it is drawn, as SVG"],
    ];
    for (const [kind, type, write, title] of kinds) {
      const button = nsbench.make("button", { type: "button", title: `Save ${title}` }, kind);
      button.addEventListener("click", async () => {
        const drawn = nsbench.drawn.get(element);
        const name = drawn.spec.usermeta.file.replace(/[^\w.=-]+/g, "_").replace(/_$/, "");
        save.file(`${name}.${kind.toLowerCase()}`, type, await write(drawn));
      });
      bar.append(button);
    }
    element.after(bar);
  },

  // Take the buttons away where nothing is drawn.
  withdraw(element) {
    if (element.nextElementSibling?.classList.contains("save")) {
      element.nextElementSibling.hidden = true;
    }
  },

  file(name, type, text) {
    const address = URL.createObjectURL(new Blob([text], { type }));
    nsbench.make("a", { href: address, download: name }).click();
    setTimeout(() => URL.revokeObjectURL(address), 10000); // the browser reads it after the click
  },

  // The rows behind a chart, their fields named as the columns of the results where they are some.
  // usermeta of a chart: file, names (of fields), every (fields that all rows share).
  table({ spec }) {
    const { names = {}, every = {} } = spec.usermeta;
    const column = (field) => names[field] ?? (field === "method" ? "solver" : field);
    const rows = spec.datasets.points.map((row) => ({
      ...every,
      ...Object.fromEntries(Object.entries(row)
        .filter(([field, value]) => value !== undefined && !save.OMITTED.includes(field))
        .map(([field, value]) => [column(field), value])),
    }));
    const head = [...new Set(rows.flatMap(Object.keys))];
    const lines = rows.map((row) => head.map((name) => save.cell(row[name])).join(","));
    return [head.map(save.cell).join(","), ...lines, ""].join("\r\n");
  },

  // Quoted as in RFC 4180 where it must be.
  cell(value) {
    const text = String(value ?? "");
    return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
  },

  // The chart on the ground of the page: the words of a dark page are not legible on white.
  async picture({ result }) {
    const svg = await result.view.toSVG();
    const ground = getComputedStyle(document.body).backgroundColor;
    return svg.replace(/<svg[^>]*>/, `$&<rect width="100%" height="100%" fill="${ground}"/>`);
  },
};
