// The cases of the answer that class and words choose.
const chosen = {
  // Does a word name a case? name[p=v] names all whose name and those parameters are the same.
  names(word, name) {
    const parts = /^([^[\]]+)\[([^\]]*)\]$/;
    const [asked, found] = [word.match(parts), name.toLowerCase().match(parts)];
    const given = found ? found[2].split(",") : [];
    return asked && found && asked[1] === found[1]
      && asked[2].split(",").every((parameter) => given.includes(parameter));
  },

  words() {
    return document.getElementById("answer-words").value.toLowerCase().split(/\s+/).filter(Boolean);
  },

  // Does a case have a word in its name, class, tags or text?
  has(one, word) {
    const about = document.querySelector(`[id="${one.id}"] .about`)?.textContent ?? "";
    const text = [one.name, one.group, ...one.tags, about].join(" ").toLowerCase();
    // a number is the value of a parameter: 30 of discs[n=30,seed=0]
    return /^[\d.]+$/.test(word) ? one.name.split(/[[\],=]/).includes(word)
      : text.includes(word) || chosen.names(word, one.name);
  },

  // Pairs of the cases chosen by class and words.
  pairs() {
    const group = document.getElementById("answer-group").value;
    const words = chosen.words();
    const data = nsbench.data;
    const cases = new Set();
    data.cases.forEach((one, k) => {
      const fits = words.every((word) => chosen.has(one, word));
      if (fits && (!group || one.group === group)) {
        cases.add(k);
      }
    });
    return { cases: [...cases], pairs: data.pairs.filter((pair) => cases.has(pair.c)) };
  },
};
