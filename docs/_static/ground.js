// One camera error, seen on the ground: arrows that the package computed beforehand.
"use strict";

const GROUND = (() => {
  const NS = "http://www.w3.org/2000/svg";

  function page(data) {
    const get = (id) => document.getElementById(id);
    const xs = data.places.map((p) => p[0]), ys = data.places.map((p) => p[1]);
    const [left, right] = [Math.min(...xs) - 12, Math.max(...xs) + 12];
    const [low, high] = [Math.min(...ys) - 16, Math.max(...ys) + 16];
    for (const name of Object.keys(data.errors)) get("error").append(new Option(name, name));

    const rms = (rows, columns) =>
      Math.sqrt(rows.reduce((sum, row) => sum + columns.reduce((s, c) => s + row[c] ** 2, 0), 0) / rows.length);

    function map(id, shift, rows) {
      const svg = get(id);
      svg.setAttribute("viewBox", `${left} ${-high} ${right - left} ${high - low}`);
      svg.replaceChildren();
      const line = (x1, y1, x2, y2, colour) => {
        const l = document.createElementNS(NS, "line");
        Object.entries({ x1, y1: -y1, x2, y2: -y2, stroke: colour, "stroke-width": 0.7 })
          .forEach(([k, v]) => l.setAttribute(k, v));
        svg.append(l);
      };
      rows.forEach((row, n) => {
        const [x, y] = data.places[n], [dx, dy] = shift(row);
        const dot = document.createElementNS(NS, "circle");
        Object.entries({ cx: x, cy: -y, r: 0.8, fill: "#222222" }).forEach(([k, v]) => dot.setAttribute(k, v));
        svg.append(dot);
        line(x, y, x + dx / 10, y + dy / 10, row[2] < 0 && id === "height" ? "#ddaa33" : "#004488");
      });
      // 1 cm on the ground is 1 m on the map.
      line(left + 2, low + 2, left + 12, low + 2, "#222222");
      const text = document.createElementNS(NS, "text");
      Object.entries({ x: left + 13, y: -low - 1, "font-size": 4 }).forEach(([k, v]) => text.setAttribute(k, v));
      text.textContent = "10 cm";
      svg.append(text);
    }

    function show() {
      const error = data.errors[get("error").value], at = error.positions[+get("size").value];
      const rows = error.rows[String(at)];
      get("size-value").textContent = `${String(at).replace("-", "\u2212")} ${error.unit}`;
      map("horizontal", (row) => [row[0], row[1]], rows);
      map("height", (row) => [0, row[2]], rows);
      get("said").textContent =
        `RMS of the check points: horizontal ${rms(rows, [0, 1]).toFixed(0)} mm, height ${rms(rows, [2]).toFixed(0)} mm`;
    }

    function chosen() {
      const error = data.errors[get("error").value];
      get("size").max = error.positions.length - 1;
      get("size").value = error.positions.length - 1;
      show();
    }
    get("error").addEventListener("input", chosen);
    get("size").addEventListener("input", show);
    chosen();
  }

  return { page };
})();
