// Distances between two pixels of the maps, and the depth along the line between them.

// Depth at (u, v), bilinear between known pixels; NaN outside the object.
function depthAt(depth, { width, height }, u, v) {
  const x = Math.max(0, Math.min(width - 1, u)), y = Math.max(0, Math.min(height - 1, v));
  const left = Math.max(0, Math.min(Math.floor(x), width - 2));
  const top = Math.max(0, Math.min(Math.floor(y), height - 2));
  let sum = 0, weight = 0;
  for (const [i, j] of [[0, 0], [1, 0], [0, 1], [1, 1]]) {
    const z = depth[(top + j) * width + left + i];
    const share = (i ? x - left : left + 1 - x) * (j ? y - top : top + 1 - y);
    if (!Number.isNaN(z) && share > 0) { sum += share * z; weight += share; }
  }
  return weight >= 0.25 ? sum / weight : NaN;
}

function distance(p, q) {
  return Math.hypot(p[0] - q[0], p[1] - q[1], p[2] - q[2]);
}

// Between the pixels a and b: distance in mm, and [mm along the line, mm towards the viewer]
// relative to the refined depth at a; NaN where there is no depth.
function measure(maps, view, a, b) {
  const ends = (name) => [a, b].map(([u, v]) => (
    view.point(u, v, depthAt(maps[name].depth, maps, u, v))));
  const [start, end] = ends("after"), long = distance(start, end);
  const way = end.map((x, k) => (x - start[k]) / long);
  const samples = Math.max(2, Math.min(600, Math.ceil(2 * Math.hypot(b[0] - a[0], b[1] - a[1]))));
  const profile = (name) => Array.from({ length: samples + 1 }, (_, i) => {
    const u = a[0] + ((b[0] - a[0]) * i) / samples, v = a[1] + ((b[1] - a[1]) * i) / samples;
    const p = view.point(u, v, depthAt(maps[name].depth, maps, u, v));
    const along = p.reduce((sum, x, k) => sum + (x - start[k]) * way[k], 0);
    return [1000 * along, 1000 * (start[2] - p[2])];
  });
  return {
    mm: { after: 1000 * long, before: 1000 * distance(...ends("before")) },
    after: profile("after"),
    before: profile("before"),
  };
}

// Heights over the straight line between the profile's own ends.
function levelled(profile) {
  const known = profile.filter(([, y]) => !Number.isNaN(y));
  if (known.length < 2) return profile;
  const [x0, y0] = known[0], [x1, y1] = known[known.length - 1];
  return profile.map(([x, y]) => [x, y - y0 - ((y1 - y0) * (x - x0)) / (x1 - x0 || 1)]);
}

function roundStep(span, most) {
  const power = 10 ** Math.floor(Math.log10(span / most));
  return power * [1, 2, 5, 10].find((step) => span / (step * power) <= most);
}

function svgElement(name, attributes, text = "") {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  made.textContent = text;
  return made;
}

// The profiles as a chart, drawn into an <svg> that is so many pixels wide.
function drawProfile(svg, { before, after }, width) {
  const height = 220, left = 56, right = 12, top = 14, bottom = 36;
  const points = [...before, ...after].filter(([x, y]) => Number.isFinite(x) && Number.isFinite(y));
  if (!points.length) return svg.replaceChildren();
  const reach = (k) => [Math.min(...points.map((p) => p[k])), Math.max(...points.map((p) => p[k]))];
  const [x0, x1] = reach(0);
  let [y0, y1] = reach(1);
  const pad = Math.max(0.05 * (y1 - y0), 0.005);
  y0 -= pad;
  y1 += pad;
  const X = (x) => left + ((x - x0) / (x1 - x0 || 1)) * (width - left - right);
  const Y = (y) => height - bottom - ((y - y0) / (y1 - y0)) * (height - top - bottom);
  const parts = [];
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  const ticks = (low, high, most, draw) => {
    const step = roundStep(high - low || 1, most);
    const digits = Math.max(0, -Math.floor(Math.log10(step)));
    for (let k = Math.ceil(low / step); k * step <= high; k++) {
      draw(k * step, (k * step || 0).toFixed(digits).replace("-", "\u2212"));
    }
  };
  ticks(y0, y1, 5, (y, label) => {
    parts.push(svgElement("line", { x1: left, x2: width - right, y1: Y(y), y2: Y(y), class: "grid" }));
    parts.push(svgElement("text", { x: left - 8, y: Y(y) + 4, "text-anchor": "end" }, label));
  });
  ticks(x0, x1, width / 80, (x, label) => {
    parts.push(svgElement("text", { x: X(x), y: height - bottom + 18, "text-anchor": "middle" }, label));
  });
  parts.push(svgElement("text", { x: width - right, y: height - 2, "text-anchor": "end" }, "mm along the line"));
  parts.push(svgElement("text", { x: 2, y: 10 }, "mm"));
  for (const [name, profile] of [["before", before], ["after", after]]) {
    let pen = "M";
    const path = profile.map(([x, y]) => {
      if (!Number.isFinite(y)) { pen = "M"; return ""; }
      const piece = `${pen}${X(x).toFixed(1)} ${Y(y).toFixed(1)}`;
      pen = "L";
      return piece;
    });
    parts.push(svgElement("path", { d: path.join(""), class: "curve " + name }));
  }
  svg.replaceChildren(...parts);
}
