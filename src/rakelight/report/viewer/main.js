// State, controls and events.  Nothing is drawn but after an input.

const root = document.documentElement;
const byId = (id) => document.getElementById(id);

const START = {
  surface: "clay", tool: "light", wipe: 0,
  azimuth: 308, elevation: 24, intensity: 1, ambient: 0.08, specular: 0, shininess: 30,
};
const SURFACES = ["clay", "colour", "normals", "confidence"];
const TOOLS = ["light", "turn", "measure"];
const LOWEST = 2;

class Viewer {
  constructor(facts, maps) {
    Object.assign(this, { facts, maps, state: { ...START }, ends: [], cross: null, frame: 0 });
    this.canvas = byId("canvas");
    this.scene = new Scene(this.canvas, facts, maps);
    this.view = new View(facts.camera, maps.after.depth);
    this.showMeshSize();
    this.bindControls();
    this.bindCanvas();
    this.bindKeys();
    this.bindPage();
    this.resize();
    this.draw();
    this.scene.finish();
  }

  // ---- drawing

  invalidate() {
    this.frame ||= requestAnimationFrame(() => this.draw());
  }

  draw() {
    this.frame = 0;
    this.scene.draw(this.view, this.state);
    this.drawOverlay();
  }

  resize() {
    const { clientWidth, clientHeight } = this.canvas, ratio = Math.min(devicePixelRatio || 1, 2);
    if (!clientWidth || !clientHeight) return;  // hidden, as on paper
    this.scene.resize(Math.round(clientWidth * ratio), Math.round(clientHeight * ratio));
    this.view.resize(clientWidth, clientHeight);
    if (this.cross) this.crossTo(...this.cross);
    this.showMeasured();
    this.invalidate();
  }

  drawOverlay() {
    const { view, state } = this, show = (id, on) => { byId(id).style.display = on ? "" : "none"; };
    const place = (id, [x, y]) => byId(id).setAttribute("transform", `translate(${x} ${y})`);
    show("lamp", state.tool === "light");
    place("lamp", this.lampOnScreen());
    show("cross", state.tool === "measure" && this.cross);
    if (this.cross) place("cross", this.cross);
    const ends = this.ends.map((end) => view.project(this.surfacePoint(end)));
    for (const [k, id] of ["end-a", "end-b"].entries()) {
      show(id, ends[k]);
      if (ends[k]) place(id, ends[k]);
    }
    show("span", ends.length === 2);
    if (ends.length === 2) {
      const [[x1, y1], [x2, y2]] = ends;
      for (const [key, value] of Object.entries({ x1, y1, x2, y2 })) byId("span").setAttribute(key, value);
    }
    const wipe = byId("wipe-handle");
    wipe.style.left = 100 * state.wipe + "%";
    wipe.classList.toggle("idle", state.wipe === 0);
    byId("legend").hidden = state.surface !== "confidence";
  }

  // ---- light

  get lampRadius() {
    return 0.47 * Math.min(this.view.width, this.view.height);
  }

  lampOnScreen() {
    const [x, y] = lightVector(this.state), r = this.lampRadius;
    return [this.view.width / 2 + r * x, this.view.height / 2 + r * y];
  }

  // The lamp stands over the point (x, y) of a hemisphere seen from above; 1 is its rim.
  lampTo(x, y) {
    const away = Math.min(1, Math.hypot(x, y));
    this.set({
      azimuth: away ? (Math.atan2(x, -y) / RADIAN + 360) % 360 : this.state.azimuth,
      elevation: Math.max(LOWEST, Math.acos(away) / RADIAN),
    });
    byId("photograph").value = "";
  }

  lampBy(azimuth, elevation) {
    this.set({
      azimuth: (this.state.azimuth + azimuth + 360) % 360,
      elevation: Math.max(LOWEST, Math.min(90, this.state.elevation + elevation)),
    });
    byId("photograph").value = "";
  }

  // ---- measuring

  surfacePoint([u, v]) {
    const z = depthAt(this.maps.after.depth, this.maps, u, v);
    return this.view.point(u, v, z);
  }

  // Set the next end of the measured line where the surface is seen at the screen's (x, y).
  markAt(x, y) {
    const { width, height } = this.view;
    const end = this.scene.pick(this.view, this.state, x / width, y / height);
    if (!end || this.surfacePoint(end).some(Number.isNaN)) {
      if (this.ends.length < 2) byId("measured").textContent = "There is no surface here.";
      return;
    }
    this.measureBetween(this.ends.length === 1 ? [this.ends[0], end] : [end]);
  }

  measureBetween(ends) {
    this.ends = ends;
    this.showMeasured();
    this.invalidate();
  }

  showMeasured() {
    const done = this.ends.length === 2;
    byId("profile").hidden = !done;
    delete byId("measured").dataset.mm;
    byId("clear").hidden = !this.ends.length;
    if (!done) {
      byId("measured").textContent = this.ends.length
        ? "First end set. Choose the second." : "Choose two points on the surface.";
      return;
    }
    const { mm, ...profiles } = measure(this.maps, this.view, ...this.ends);
    const text = (value) => (Number.isFinite(value) ? `${value.toFixed(2)} mm` : "no depth");
    byId("measured").textContent = `Distance ${text(mm.after)} (before: ${text(mm.before)})`;
    byId("measured").dataset.mm = mm.after;
    if (byId("level").checked) {
      for (const name of ["before", "after"]) profiles[name] = levelled(profiles[name]);
    }
    drawProfile(byId("profile-chart"), profiles, this.canvas.clientWidth);
  }

  // ---- controls: every one shows the state, and changes it

  set(changes) {
    Object.assign(this.state, changes);
    this.showState();
    this.invalidate();
  }

  showState() {
    const { state } = this;
    for (const input of document.querySelectorAll("[data-state-key]")) {
      const value = state[input.dataset.stateKey];
      if (input.type === "radio") input.checked = input.value === value;
      else input.value = value;
    }
    const say = {
      azimuth: `${Math.round(state.azimuth) % 360}°, ${fromWhere(state)}`,
      elevation: `${Math.round(state.elevation)}°`,
      intensity: state.intensity.toFixed(2),
      ambient: state.ambient.toFixed(2),
      specular: state.specular.toFixed(2),
      shininess: String(Math.round(state.shininess)),
      wipe: state.wipe ? `${Math.round(100 * state.wipe)} % before` : "after",
    };
    for (const [key, text] of Object.entries(say)) {
      byId(key + "-value").textContent = text;
      byId(key).setAttribute("aria-valuetext", text);
    }
    byId("wipe-handle").setAttribute("aria-valuenow", Math.round(100 * state.wipe));
    byId("wipe-handle").setAttribute("aria-valuetext", say.wipe);
    byId("measuring").hidden = state.tool !== "measure";
    this.canvas.dataset.tool = state.tool;
    const [x, y] = lightVector(state);
    byId("dial-lamp").setAttribute("transform", `translate(${50 * x} ${50 * y})`);
  }

  bindControls() {
    for (const input of document.querySelectorAll("[data-state-key]")) {
      input.addEventListener("input", () => {
        const value = input.type === "radio" ? input.value : Number(input.value);
        if (input.type === "radio" && !input.checked) return;
        this.set({ [input.dataset.stateKey]: value });
        if (["azimuth", "elevation"].includes(input.id)) byId("photograph").value = "";
      });
    }
    byId("photograph").addEventListener("input", ({ target }) => {
      const lamp = this.facts.lights[target.value];
      if (lamp) this.set({ azimuth: lamp.azimuth, elevation: Math.max(LOWEST, lamp.elevation) });
    });
    byId("reset").addEventListener("click", () => this.reset());
    byId("clear").addEventListener("click", () => this.measureBetween([]));
    byId("level").addEventListener("input", () => this.showMeasured());
    byId("save").addEventListener("click", () => this.savePicture());
    const dial = byId("dial");
    dragging(dial, (event) => {
      const box = dial.getBoundingClientRect(), r = (box.width * 50) / 120;
      this.lampTo(
        (event.clientX - box.left - box.width / 2) / r,
        (event.clientY - box.top - box.height / 2) / r,
      );
    });
    dragging(byId("wipe-handle"), (event) => {
      const box = this.canvas.getBoundingClientRect();
      this.wipeTo((event.clientX - box.left) / box.width);
    });
    byId("wipe-handle").addEventListener("keydown", (event) => {
      const step = {
        ArrowLeft: -0.02, ArrowDown: -0.02, ArrowRight: 0.02, ArrowUp: 0.02,
        PageDown: -0.1, PageUp: 0.1, Home: -1, End: 1,
      }[event.key];
      if (!step) return;
      event.preventDefault();
      this.wipeTo(this.state.wipe + step);
    });
    byId("photograph").value = "";  // a browser that goes back fills it in, and nothing else
    this.showState();
    this.showMeasured();
  }

  wipeTo(share) {
    this.set({ wipe: Math.round(1000 * Math.max(0, Math.min(1, share))) / 1000 });
  }

  reset() {
    this.view.reset();
    byId("photograph").value = "";
    this.set({ ...START, tool: this.state.tool });
  }

  // The picture, with the measured line where its length is shown, too: for paper.
  pictureWithLine() {
    const picture = document.createElement("canvas"), { canvas, view } = this;
    this.draw();
    Object.assign(picture, { width: canvas.width, height: canvas.height });
    const pen = picture.getContext("2d"), ratio = canvas.width / view.width;
    pen.drawImage(canvas, 0, 0);
    pen.scale(ratio, ratio);
    pen.strokeStyle = pen.fillStyle = getComputedStyle(root).getPropertyValue("--lamp");
    pen.lineWidth = 1.6;
    const measured = this.state.tool === "measure" && this.ends.length === 2;
    const ends = (measured ? this.ends : []).map((end) => view.project(this.surfacePoint(end)));
    pen.beginPath();
    for (const [x, y] of ends) pen.lineTo(x, y);
    pen.setLineDash([6, 4]);
    pen.stroke();
    for (const [x, y] of ends) {
      pen.beginPath();
      pen.arc(x, y, 5, 0, 7);
      pen.fill();
    }
    return picture.toDataURL("image/jpeg", 0.92);
  }

  // What the picture shows, for paper.
  describe() {
    const { state, view } = this, parts = [{ colour: "albedo" }[state.surface] ?? state.surface];
    if (state.surface === "clay" || state.surface === "colour") {
      parts.push(`lamp at the ${fromWhere(state)} (${Math.round(state.azimuth) % 360}°), `
        + `${Math.round(state.elevation)}° over the picture, intensity ${state.intensity.toFixed(2)}, `
        + `ambient ${state.ambient.toFixed(2)}`);
      if (state.specular) parts.push(`specular enhance ${state.specular.toFixed(2)}`);
    }
    if (view.yaw || view.pitch) {
      parts.push(`turned ${Math.round(view.yaw)}° and ${Math.round(view.pitch)}°`);
    }
    if (state.wipe) parts.push(`before in the left ${Math.round(100 * state.wipe)} %`);
    return `As shown: ${parts.join("; ")}.`;
  }

  savePicture() {
    const link = document.createElement("a");
    this.draw();
    link.href = this.canvas.toDataURL("image/png");
    link.download = "view.png";
    link.click();
  }

  // ---- pointers: one finger or button does what the tool says, two fingers zoom and move

  bindCanvas() {
    const { canvas, view } = this, fingers = new Map();
    const spot = (event) => {
      const box = canvas.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    const task = (event) => {
      if (event.button === 2 || event.shiftKey) return "turn";
      return event.button === 1 || event.ctrlKey || event.metaKey ? "move" : this.state.tool;
    };
    let doing = "", undo = () => {};
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, spot(event));
      doing = fingers.size > 1 ? "pinch" : task(event);
      if (doing === "pinch") undo();  // what the first of two fingers has done
      undo = this.remembered();
      if (doing === "light") this.lampToScreen(...spot(event));
      if (doing === "measure") this.markAt(...spot(event));
      if (event.button === 1) event.preventDefault();
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!fingers.has(event.pointerId)) return;
      const before = fingers.get(event.pointerId), now = spot(event);
      const by = [now[0] - before[0], now[1] - before[1]];
      fingers.set(event.pointerId, now);
      if (doing === "light") return this.lampToScreen(...now);
      if (doing === "turn") view.turnBy(0.4 * by[0], -0.4 * by[1]);
      if (doing === "move") view.panBy(...by);
      if (doing === "pinch" && fingers.size === 2) {
        const [other] = [...fingers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
        const apart = (p) => Math.max(10, Math.hypot(p[0] - other[0], p[1] - other[1]));
        view.zoomBy(apart(now) / apart(before), (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
        view.panBy(by[0] / 2, by[1] / 2);
      }
      this.invalidate();
    });
    for (const end of ["pointerup", "pointercancel"]) {
      canvas.addEventListener(end, (event) => {
        fingers.delete(event.pointerId);
        doing = "";
      });
    }
    canvas.addEventListener("contextmenu", (event) => event.preventDefault());
    canvas.addEventListener("wheel", (event) => {
      if (document.activeElement !== canvas) return;  // the page scrolls until one works here
      event.preventDefault();
      view.zoomBy(Math.exp(-event.deltaY * (event.deltaMode ? 0.05 : 0.0015)), ...spot(event));
      this.invalidate();
    }, { passive: false });
  }

  // Brings back the lamp and the measured line as they are now.
  remembered() {
    const { ends, state: { azimuth, elevation } } = this, photograph = byId("photograph").value;
    return () => {
      this.set({ azimuth, elevation });
      byId("photograph").value = photograph;
      this.measureBetween(ends);
    };
  }

  lampToScreen(x, y) {
    const { view: { width, height }, lampRadius: r } = this;
    this.lampTo((x - width / 2) / r, (y - height / 2) / r);
  }

  // ---- keys, while the picture has the focus

  bindKeys() {
    this.canvas.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey) return;
      if (this.key(event.key, event.shiftKey)) {
        event.preventDefault();
        this.invalidate();
      }
    });
  }

  key(key, shift) {
    const { view, state } = this;
    const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[key];
    if (arrow) {
      const [x, y] = arrow;
      if (state.tool === "measure") {
        const [cx, cy] = this.cross ?? [view.width / 2, view.height / 2], by = shift ? 1 : 10;
        this.crossTo(cx + by * x, cy + by * y);
      } else if (shift) view.panBy(20 * x, 20 * y);
      else if (state.tool === "turn") view.turnBy(5 * x, -5 * y);
      else this.lampBy(5 * x, -5 * y);
      return true;
    }
    const tool = TOOLS.find((name) => name[0] === key.toLowerCase());
    const surface = SURFACES[Number(key) - 1];
    const actions = {
      "+": () => view.zoomBy(1.2),
      "=": () => view.zoomBy(1.2),
      "-": () => view.zoomBy(1 / 1.2),
      "0": () => this.reset(),
      "[": () => this.wipeTo(state.wipe - 0.05),
      "]": () => this.wipeTo(state.wipe + 0.05),
      "Escape": () => this.measureBetween([]),
      "Enter": () => this.markAtCross(),
      " ": () => this.markAtCross(),
    };
    if (tool) this.set({ tool });
    else if (surface) this.set({ surface });
    else if (actions[key]) actions[key]();
    else return false;
    return true;
  }

  crossTo(x, y) {
    const within = (value, size) => Math.max(0, Math.min(size - 1, value));
    this.cross = [within(x, this.view.width), within(y, this.view.height)];
  }

  markAtCross() {
    if (this.state.tool !== "measure") return;
    this.cross ??= [this.view.width / 2, this.view.height / 2];
    this.markAt(...this.cross);
  }

  // ---- the page around

  bindPage() {
    new ResizeObserver(() => this.resize()).observe(this.canvas);
    this.canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    this.canvas.addEventListener("webglcontextrestored", () => {
      this.scene = new Scene(this.canvas, this.facts, this.maps);
      this.resize();
    });
    window.addEventListener("beforeprint", () => {
      byId("still").src = this.pictureWithLine();
      byId("still-caption").textContent = this.describe();
    });
  }

  showMeshSize() {
    const { count, step } = this.scene.surfaces.after;
    const every = step === 1 ? "every pixel" : `every ${step}${["th", "st", "nd", "rd"][step] ?? "th"} pixel`;
    byId("mesh-size").textContent = `The shape is drawn with ${(count / 3).toLocaleString("en")} `
      + `triangles, ${every}; the normals carry every pixel.`;
    this.canvas.dataset.triangles = count / 3;
  }
}

// Paper shows what the page folds away.
const unfolded = [];

function unfold() {
  for (const one of document.querySelectorAll("details:not([open])")) {
    one.open = true;
    unfolded.push(one);
  }
}

function fold() {
  for (const one of unfolded.splice(0)) one.open = false;
}

window.addEventListener("beforeprint", unfold);
window.addEventListener("afterprint", fold);

// Call `move` for the press and every movement of a pointer that was pressed on an element.
function dragging(element, move) {
  element.addEventListener("pointerdown", (event) => {
    element.setPointerCapture(event.pointerId);
    move(event);
  });
  element.addEventListener("pointermove", (event) => {
    if (element.hasPointerCapture(event.pointerId)) move(event);
  });
}

function fromWhere({ azimuth, elevation }) {
  if (elevation > 85) return "front";
  const names = ["top", "upper right", "right", "lower right", "bottom", "lower left", "left", "upper left"];
  return names[Math.round(azimuth / 45) % 8];
}

async function start() {
  const facts = JSON.parse(byId("facts").textContent);
  if (!document.createElement("canvas").getContext("webgl2")) throw new NoWebGL();
  const maps = await unpackMaps(facts);
  byId("viewer").hidden = false;
  new Viewer(facts, maps);
  root.dataset.state = "ready";
}

// Without the viewer the page is its pictures.
function fall(state, words) {
  byId("viewer").hidden = true;
  byId("fallback").hidden = false;
  byId("fallback").textContent = words;
  root.dataset.state = state;
}

start().catch((error) => {
  if (error instanceof NoWebGL) {
    fall("nowebgl", "This browser shows no WebGL 2, so the surface cannot be turned and relit "
      + "here. The pictures below show the same; a browser with WebGL 2 shows more.");
  } else if (error instanceof TooOld) {
    fall("failed", "This browser cannot unpack the maps of this page, so the surface cannot be "
      + "turned and relit here. The pictures below show the same; a browser of 2023 or later shows more.");
  } else {
    fall("failed", `The viewer could not start (${error.message}). The pictures below show the result.`);
  }
});
