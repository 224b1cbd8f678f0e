// The numbers of all motions, and which of them is marked.

function cell(row, text, kind, tag = "td") {
  const made = document.createElement(tag);
  made.textContent = text;
  if (kind) made.className = kind;
  row.append(made);
  return made;
}

// What all motions tell: by what it is, its unit and the value of each, in the order of the one of which most is known.
function known(key) {
  const found = new Map();
  for (const told of [...data.takes].sort((a, b) => b[key].length - a[key].length)) {
    for (const [what, value, unit] of told[key]) {
      if (!found.has(what)) found.set(what, { unit, values: data.takes.map(() => "–") });
      found.get(what).values[data.takes.indexOf(told)] = value;
    }
  }
  for (const one of found.values()) {
    one.differs = new Set(one.values.filter((value) => value !== "–")).size > 1;
  }
  return found;
}

// A row for everything that is told, a column for each motion.
function fill(body, key) {
  const found = known(key);
  for (const [what, { unit, values, differs }] of found) {
    const row = body.insertRow();
    if (differs) row.className = "differs";
    cell(row, what);
    for (const value of values) cell(row, value);
    cell(row, unit, "unit");
  }
  return found.size;
}

// A row for each motion, a column for all in which they differ, and a row below for what is the same in all.
function across(table, key) {
  const found = [...known(key)];
  const differing = found.filter(([, { differs }]) => differs);
  const head = table.tHead.insertRow();
  cell(head, "Run", "", "th");
  for (const [what, { unit }] of differing) {
    const place = cell(head, what, "", "th");
    if (unit) place.appendChild(document.createElement("small")).textContent = ` ${unit}`;
  }
  walkers.forEach((walker, k) => {
    const row = table.tBodies[0].insertRow();
    const first = cell(row, "", "", "th");
    first.append(eye(walker), ` ${k + 1} `, walker.told.name.replace(/_/g, "_\u200b"));
    for (const [, { values }] of differing) cell(row, values[k]);
    follow(row, walker);
  });
  const same = found.filter(([, { differs }]) => !differs);
  const below = table.createTFoot();
  const wide = Math.max(1, differing.length);
  if (same.length) cell(below.insertRow(), "The same in all", "first", "th").colSpan = 1 + wide;
  for (const [what, { unit, values }] of same) {
    const row = below.insertRow();
    cell(row, what, "", "th");
    cell(row, `${values.find((value) => value !== "–")} ${unit}`).colSpan = wide;
  }
  return found.length;
}

// A motion is marked while its row is pointed at, and stays so once that is pressed.
function follow(row, walker) {
  row.tabIndex = 0;
  row.setAttribute("aria-selected", "false");
  const show = (marked) => {
    walker.marked = marked || row.getAttribute("aria-selected") === "true";
    row.classList.toggle("marked", walker.marked);
    if (stage) pose();
  };
  const press = () => {
    row.setAttribute("aria-selected", String(row.getAttribute("aria-selected") !== "true"));
    show(false);
  };
  row.addEventListener("pointerenter", () => show(true));
  row.addEventListener("pointerleave", () => show(false));
  row.addEventListener("focus", () => show(true));
  row.addEventListener("blur", () => show(false));
  row.addEventListener("click", press);
  row.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" || event.target !== row) return;
    event.preventDefault();
    press();
  });
}

// A button in a motion's colour that shows or hides it.
function eye(walker) {
  const button = document.createElement("button");
  const swatch = document.createElement("span");
  swatch.className = "swatch";
  swatch.style.background = walker.tint;
  button.type = "button";
  button.setAttribute("aria-pressed", "true");
  button.setAttribute("aria-label", `Show or hide ${walker.told.name}`);
  button.title = "Show or hide";
  button.append(swatch);
  button.addEventListener("click", (event) => {
    event.stopPropagation();
    walker.visible = !walker.visible;
    button.setAttribute("aria-pressed", String(walker.visible));
    pose();
  });
  return button;
}

function table() {
  const more = element("more").querySelector("table");
  if (many) {
    across(element("numbers"), "shown");
    element("more").hidden = !across(more, "more");
    return;
  }
  const head = element("numbers").tHead.insertRow();
  cell(head, "", "", "th");
  for (const walker of walkers) {
    const title = several ? eye(walker) : document.createElement("span");
    // Long names are broken where they have a joint.
    title.append(walker.told.name.replace(/_/g, "_\u200b"));
    cell(head, "", "", "th").append(title);
  }
  cell(head, "", "", "th");
  fill(element("numbers").tBodies[0], "shown");
  element("more").hidden = !fill(more.tBodies[0], "more");
}
