// The turning bicycle wheel of corridor/tools/readout/render.py, drawn in the browser: every row at its own
// time, exposure and the width of a pixel integrated the same way. A test holds the two together.
"use strict";

const WHEEL = (() => {
  const TAU = 2 * Math.PI;
  const FINEST = (0.25 * Math.PI) / 180;
  // The page's scene: docs/lessons.py writes it from the package's own.
  const at = (o, X, Y, Z, x, y, z, n) => o[n] + X[n] * x + Y[n] * y + Z[n] * z;

  const clamped = (x, half) => {
    const size = Math.abs(x);
    return size < half ? 0.5 * x * x : half * size - 0.5 * half * half;
  };

  const covered = (d0, d1, half) => {
    if (Math.abs(d1 - d0) < 1e-4) {
      const d = 0.5 * (d0 + d1);
      return Math.max(Math.min(d + 0.5, half) - Math.max(d - 0.5, -half), 0);
    }
    return (clamped(d1 + 0.5, half) - clamped(d1 - 0.5, half)
      - clamped(d0 + 0.5, half) + clamped(d0 - 0.5, half)) / (d1 - d0);
  };

  const share = (r, edge, pixel) => Math.min(Math.max((edge - r) / pixel + 0.5, 0), 1);

  function plane(scene) {
    const { width, height, focal, centre, to_plane: m } = scene;
    const x = new Float64Array(width * height), y = new Float64Array(width * height);
    for (let i = 0; i < height; i++) {
      for (let j = 0; j < width; j++) {
        const u = (j - centre[0]) / focal, v = (i - centre[1]) / focal;
        const depth = m[2][0] * u + m[2][1] * v + m[2][2];
        x[i * width + j] = (m[0][0] * u + m[0][1] * v + m[0][2]) / depth;
        y[i * width + j] = (m[1][0] * u + m[1][1] * v + m[1][2]) / depth;
      }
    }
    return { x, y };
  }

  // Linear light, 0 to 1, row by row. turns: a second, clockwise positive.
  function light(scene, setting) {
    const { width, height, focal, centre, origin, axes, ends, circles } = scene;
    const [X, Y, Z] = [0, 1, 2].map((k) => axes.map((row) => row[k]));
    const { x, y } = (scene.plane = scene.plane || plane(scene));
    const omega = TAU * setting.turns, turn = omega * setting.exposure_s;
    const pieces = Math.max(1, Math.ceil(Math.abs(turn) / FINEST));
    const count = ends.length, middle = Math.floor(pieces / 2);
    const line = new Float64Array(count * (pieces + 1) * 3), along = new Float64Array(count * 4);
    const wide = new Float64Array(count), reach = new Float64Array(count);
    const out = new Float64Array(width * height);
    const a = [0, 0, 0], b = [0, 0, 0];
    for (let i = 0; i < height; i++) {
      const time = setting.readout_s * (i / Math.max(height - 1, 1) - 0.5);
      const turned = setting.phase + omega * time;
      const v = (i - centre[1]) / focal;
      for (let s = 0; s < count; s++) {
        const [r0, t0, h0, r1, t1, h1, width_m] = ends[s];
        let far = 0;
        for (let k = 0; k <= pieces; k++) {
          const theta = turned + turn * (k / pieces - 0.5);
          for (let n = 0; n < 3; n++) {
            a[n] = at(origin, X, Y, Z, r0 * Math.cos(t0 + theta), r0 * Math.sin(t0 + theta), h0, n);
            b[n] = at(origin, X, Y, Z, r1 * Math.cos(t1 + theta), r1 * Math.sin(t1 + theta), h1, n);
          }
          const n0 = a[1] * b[2] - a[2] * b[1], n1 = a[2] * b[0] - a[0] * b[2];
          const n2 = a[0] * b[1] - a[1] * b[0], scale = focal / Math.hypot(n0, n1);
          line.set([n0 * scale, n1 * scale, n2 * scale], (s * (pieces + 1) + k) * 3);
          if (k === middle) {
            const au = a[0] / a[2], av = a[1] / a[2], bu = b[0] / b[2], bv = b[1] / b[2];
            const size = (bu - au) ** 2 + (bv - av) ** 2;
            const p = (bu - au) / size, q = (bv - av) / size;
            far = Math.sqrt(size) * focal;
            along.set([p, q, -(au * p + av * q), far], s * 4);
            wide[s] = (0.5 * width_m * focal * 2) / (a[2] + b[2]);
          }
        }
        reach[s] = wide[s] + 2 + Math.abs(turn) * 1.3 * far;
      }
      for (let j = 0; j < width; j++) {
        const here = i * width + j, next = j + 1 < width ? here + 1 : here - 1;
        const r = Math.hypot(x[here], y[here]);
        const pixel = Math.hypot(x[next] - x[here], y[next] - y[here]);
        if (!(r < circles[3] + pixel)) { out[here] = scene.background; continue; }
        const u = (j - centre[0]) / focal;
        let clear = 1;
        if (r < circles[1] + pixel) {
          for (let s = 0; s < count; s++) {
            let n = s * (pieces + 1) * 3;
            let d = line[n] * u + line[n + 1] * v + line[n + 2];
            if (Math.abs(d) > reach[s]) continue;
            const where = along[4 * s] * u + along[4 * s + 1] * v + along[4 * s + 2];
            const inside = Math.min(where, 1 - where) * along[4 * s + 3] + 0.5;
            if (inside <= 0) continue;
            let part = 0;
            for (let k = 1; k <= pieces; k++) {
              n += 3;
              const e = line[n] * u + line[n + 1] * v + line[n + 2];
              part += covered(d, e, wide[s]);
              d = e;
            }
            clear *= 1 - (Math.min(inside, 1) * part) / pieces;
          }
        }
        let lit = scene.bright * (1 - clear), cover = 1 - clear;
        const disc = share(r, circles[0], pixel);
        lit = lit * (1 - disc) + 2.5 * scene.dark * disc;
        cover = cover * (1 - disc) + disc;
        const rim = 1 - share(r, circles[1], pixel);
        lit = lit * (1 - rim) + scene.bright * rim;
        cover = cover * (1 - rim) + rim;
        const rubber = 1 - share(r, circles[2], pixel);
        lit = lit * (1 - rubber) + scene.dark * rubber;
        const outer = share(r, circles[3], pixel);
        out[here] = lit * outer + (1 - cover * outer) * scene.background;
      }
    }
    return out;
  }

  // 8-bit sRGB (IEC 61966-2-1) of linear light.
  const encoded = (l) => Math.round(255 * (l <= 0.0031308 ? 12.92 * l : 1.055 * l ** (1 / 2.4) - 0.055));

  function draw(canvas, scene, setting) {
    canvas.width = scene.width;
    canvas.height = scene.height;
    const context = canvas.getContext("2d"), image = context.createImageData(scene.width, scene.height);
    light(scene, setting).forEach((l, n) => {
      const grey = encoded(Math.min(Math.max(l, 0), 1));
      image.data.set([grey, grey, grey, 255], 4 * n);
    });
    context.putImageData(image, 0, 0);
  }

  function page(scene, measured) {
    const get = (id) => document.getElementById(id);
    const say = (n, digits) => n.toFixed(digits).replace("-", "\u2212");
    const show = () => {
      const readout = +get("readout").value, turns = +get("turns").value;
      const sense = get("sense").value, exposure = +get("exposure").value;
      get("readout-value").textContent = `${readout} ms`;
      get("turns-value").textContent = `${turns} a second`;
      draw(get("turning"), scene, {
        readout_s: readout / 1e3, exposure_s: exposure / 1e3,
        turns: turns * (sense === "cw" ? 1 : -1), phase: scene.phase,
      });
      const found = measured[[readout, turns, sense, exposure].join(" ")];
      get("number").textContent = found
        ? `measured in such a picture: ${say(found[0], 2)} \u00b1 ${say(found[1], 2)} ms`
        : "nothing can be measured in such a picture";
    };
    draw(get("still"), scene, { readout_s: 0, exposure_s: 0, turns: 0, phase: scene.phase_at_rest });
    for (const id of ["readout", "turns", "sense", "exposure"]) get(id).addEventListener("input", show);
    show();
  }

  return { light, draw, page, encoded };
})();

if (typeof module !== "undefined") module.exports = WHEEL;
