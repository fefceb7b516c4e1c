// Interactive view of a body in a notebook: shows the latest picture, and sends pointer input to the kernel.

const HANDS = [
  ["look", "Look", "Drag to orbit the body, with Shift to pan; turn the wheel to zoom"],
  ["press", "Press", "Place the fingertip on the body and drag away from that point to press deeper"],
  ["cut", "Cut", "Draw a stroke that starts on the body"],
];
const SVG = "http://www.w3.org/2000/svg";

function element(name, attributes = {}, ...inside) {
  const made = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key in made && key !== "list") made[key] = value;
    else made.setAttribute(key, value);
  }
  made.append(...inside);
  return made;
}

/** Creates a selection bound to a trait of the model; `none` is the label of the empty choice. */
function choice(model, trait, options, label, none) {
  const select = element("select", { ariaLabel: label });
  const fill = () => {
    const all = none === undefined ? options() : ["", ...options()];
    select.replaceChildren(...all.map((o) => element("option", { value: o, textContent: o || none })));
    select.value = model.get(trait);
  };
  fill();
  select.addEventListener("change", () => { model.set(trait, select.value); model.save_changes(); });
  model.on(`change:${trait}`, fill);
  return element("label", {}, label, select);
}

/** Creates a slider; `get` and `put` access the model. */
function slider(label, get, put, [min, max] = [0, 1]) {
  const input = element("input", { type: "range", min, max, step: (max - min) / 200, ariaLabel: label });
  input.value = get();
  input.addEventListener("input", () => put(Number(input.value)));
  return element("label", {}, label, input);
}

function render({ model, el }) {
  const [width, height] = model.get("size");
  const canvas = element("canvas", { width, height, tabIndex: 0, ariaLabel: "A body that can be pressed on" });
  const stroke = document.createElementNS(SVG, "svg");
  stroke.setAttribute("class", "stroke");
  stroke.setAttribute("viewBox", "0 0 1 1");
  stroke.setAttribute("preserveAspectRatio", "none");
  const line = document.createElementNS(SVG, "polyline");
  for (const [k, v] of [["fill", "none"], ["stroke", "#f0e442"], ["stroke-width", "2"], ["vector-effect", "non-scaling-stroke"]]) line.setAttribute(k, v);
  stroke.append(line);
  const said = element("div", { className: "said", role: "status" });
  const curve = document.createElementNS(SVG, "svg");
  curve.setAttribute("class", "curve");
  curve.setAttribute("viewBox", "0 0 160 60");
  const told = element("span");

  // Each frame contains the number of messages that the kernel has handled.
  const say = (message) => {
    root.dataset.sent = Number(root.dataset.sent) + 1;
    model.send(message);
  };

  let hand = "look";
  const buttons = HANDS.map(([name, text, title]) => {
    const button = element("button", { textContent: text, title, ariaPressed: String(name === hand) });
    button.addEventListener("click", () => {
      hand = name;
      buttons.forEach((b, n) => (b.ariaPressed = String(HANDS[n][0] === hand)));
    });
    return button;
  });
  const reset = element("button", { textContent: "Reset", title: "Reset the body to its uncut rest state" });
  reset.addEventListener("click", () => say({ kind: "reset" }));

  const set = (trait, value) => { model.set(trait, value); model.save_changes(); };
  const whole = () => model.get("whole");
  const part = (n) => (model.get("range")[n] - whole()[0]) / (whole()[1] - whole()[0] || 1);
  const ranged = (n) => (share) => {
    const both = [...model.get("range")];
    both[n] = whole()[0] + share * (whole()[1] - whole()[0]);
    if (both[0] < both[1]) set("range", both);
  };
  const controls = element("div", { className: "row" },
    choice(model, "field", () => model.get("fields"), "Field", "automatic"),
    choice(model, "colour", () => model.get("colours"), "Colours", "automatic"),
    slider("Opacity", () => Math.log10(model.get("opacity_scale")), (v) => set("opacity_scale", 10 ** v), [-1.5, 1.5]),
    slider("From", () => part(0), ranged(0)),
    slider("To", () => part(1), ranged(1)),
    choice(model, "plane", () => ["x", "y", "z"], "Clip along", "none"),
    slider("at", () => model.get("plane_position"), (v) => set("plane_position", v)));
  const hands = element("div", { className: "row" }, ...buttons, reset, curve, told);
  const root = element("div", { className: "palpate-view" },
    hands, element("div", { className: "body" }, canvas, stroke), controls, said);
  root.style.width = `${width}px`;
  root.dataset.sent = 0;
  el.append(root);

  // Shows a picture; the next one is sent after this one is acknowledged.
  const onMessage = async (message, buffers) => {
    if (message.kind !== "frame") return;
    const bitmap = await createImageBitmap(new Blob([buffers[0]], { type: "image/jpeg" })).catch(() => null);
    if (bitmap) {
      canvas.getContext("2d").drawImage(bitmap, 0, 0, canvas.width, canvas.height);
      root.dataset.frame = message.number;
      root.dataset.width = bitmap.width;
      root.dataset.heard = message.heard;
    }
    model.send({ kind: "got", number: message.number });
  };
  model.on("msg:custom", onMessage);
  const onSaid = () => (said.textContent = model.get("said"));
  model.on("change:said", onSaid);
  const onCurve = () => {
    const points = model.get("curve");
    curve.replaceChildren();
    if (points.length < 2) return (told.textContent = "");
    const most = (n) => Math.max(...points.map((p) => Math.abs(p[n])), 1e-12);
    const [deepest, strongest] = [most(0), most(1)];
    const drawn = document.createElementNS(SVG, "polyline");
    drawn.setAttribute("points", points.map(([d, f]) => `${(154 * Math.max(d, 0)) / deepest + 3},${57 - (54 * Math.max(f, 0)) / strongest}`).join(" "));
    drawn.setAttribute("fill", "none");
    drawn.setAttribute("stroke", "currentColor");
    curve.append(drawn);
    const [depth, force] = points[points.length - 1];
    told.textContent = `${force.toPrecision(3)} N at ${depth.toPrecision(3)} mm`;
  };
  model.on("change:curve", onCurve);
  onSaid();
  onCurve();

  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  };
  let held;
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    const pans = event.shiftKey || event.button === 1;
    held = { does: hand === "look" && pans ? "pan" : hand, last: at(event), first: at(event), way: [at(event)] };
    if (held.does === "press") say({ kind: "press", x: held.first[0], y: held.first[1] });
    event.preventDefault();
    canvas.focus();
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!held) return;
    const now = at(event);
    const [dx, dy] = [now[0] - held.last[0], now[1] - held.last[1]];
    const ratio = canvas.width / canvas.height;
    if (held.does === "look") say({ kind: "turn", x: dx, y: dy });
    if (held.does === "pan") say({ kind: "pan", x: dx * ratio, y: dy });
    if (held.does === "press") {
      const away = Math.hypot((now[0] - held.first[0]) * ratio, now[1] - held.first[1]);
      say({ kind: "deeper", depth: 0.5 * away });
    }
    if (held.does === "cut") {
      held.way.push(now);
      line.setAttribute("points", held.way.map((p) => p.join(",")).join(" "));
    }
    held.last = now;
  });
  const end = () => {
    if (held?.does === "press") say({ kind: "release" });
    if (held?.does === "cut") say({ kind: "cut", way: held.way });
    line.setAttribute("points", "");
    held = undefined;
  };
  canvas.addEventListener("pointerup", end);
  canvas.addEventListener("pointercancel", end);
  canvas.addEventListener("wheel", (event) => {
    say({ kind: "zoom", by: -event.deltaY / 500 });
    event.preventDefault();
  }, { passive: false });
  canvas.addEventListener("keydown", (event) => {
    const turns = { ArrowLeft: [-0.05, 0], ArrowRight: [0.05, 0], ArrowUp: [0, -0.05], ArrowDown: [0, 0.05] };
    if (event.key in turns) say({ kind: "turn", x: turns[event.key][0], y: turns[event.key][1] });
    else if (event.key === "+" || event.key === "=") say({ kind: "zoom", by: 0.15 });
    else if (event.key === "-") say({ kind: "zoom", by: -0.15 });
    else return;
    event.preventDefault();
    event.stopPropagation();
  });
  model.send({ kind: "shown" });
  return () => {
    model.off("msg:custom", onMessage);
    model.off("change:said", onSaid);
    model.off("change:curve", onCurve);
  };
}

export default { render };
