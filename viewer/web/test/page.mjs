// Tests of the viewer in a page: the session of viewer/tests/window with its golden images, and
// features that only a page has. Run by scripts/test page.

import fs from "node:fs";
import path from "node:path";
import { OUT, Page, ROOT, apart, check, drawn, launch, serve, sleep } from "./harness.mjs";

/** As in viewer/tests/window: maximum root mean square difference of matching images, and minimum of different ones. */
const ALIKE = 0.012;
const OTHER = 0.02;
/** Maximum difference between the pictures of the page and of the command. */
const SAME = 1 / 255;

const CAMERA = { eye: [-0.12, -0.45, 0.45], look_at: [0.165, 0.005, 0.0], up: [0, 0, 1], fov: 22 };
const file = (name) => fs.readFileSync(path.join(ROOT, "data", name));
const { server, at } = await serve();
let browser;

async function part(name, run) {
  const since = Date.now();
  console.log(`page: ${name}`);
  await run();
  console.log(`page: ${name} took ${((Date.now() - since) / 1000).toFixed(1)} s`);
}

/** Reruns a failed part in a new browser, and reports it if it then passes. */
async function again(name, run, why) {
  console.error(why);
  await browser.close();
  browser = await launch();
  await part(name, run);
  const said = `page: ${name}: failed once, passed by itself`;
  console.log(`rerun: ${said}`);
  if (process.env.RERUNS) fs.appendFileSync(process.env.RERUNS, `${said}\n`);
}

/** Waits for an event `error` whose message contains `what`. */
async function hear(view, what) {
  const heard = [];
  for (const since = Date.now(); Date.now() - since < 600_000; await sleep(50)) {
    heard.push(...(await view.events()));
    if (heard.some(([name, detail]) => name === "error" && detail.message.includes(what))) return;
  }
  throw new Error(`no event \`error\` contains "${what}": ${JSON.stringify(heard)}`);
}

/** Opens, orbits, presses, pulls, cuts, clips, undoes and edits colours, with the golden images of the window. */
async function session() {
  const view = await Page.open(browser, `${at}/?example=limb`);
  await view.page.waitForFunction("window.firstPicture", { timeout: 600_000 });
  const [first, arrived] = await view.page.evaluate(() => {
    const wasm = performance.getEntriesByType("resource").find((entry) => entry.name.endsWith(".wasm"));
    return [window.firstPicture, wasm.responseEnd];
  });
  console.log(`first picture ${(first - arrived).toFixed(0)} ms after the module was loaded`);
  await view.rest();
  await view.click(400, 700);
  const open = await view.holdAgainst("open", ALIKE);
  check((await view.events()).some(([name, detail]) => name === "load" && detail.tets > 5000), "no event `load`");

  await view.key("1");
  await view.hold([400, 400], [520, 340]);
  const orbited = (await view.state()).camera;
  await view.letGo();
  await view.key("a");
  await view.rest();
  check(JSON.stringify((await view.state()).camera) !== JSON.stringify(orbited), "the key a does not change the camera");
  await view.key("f");
  await view.rest();
  const side = await view.holdAgainst("side", ALIKE);
  check(apart(open, side) > OTHER, "a different view must change the picture");
  check((await view.events()).some(([name, camera]) => name === "camera" && camera.fov > 0), "no event `camera`");

  await view.key("2");
  await view.hold([400, 400], [400, 440]);
  const pressed = await view.wait("a press", (state) => state.force_n > 1);
  check(pressed.depth_m > 1e-3, JSON.stringify(pressed));
  await view.rest();
  check(apart(side, await view.shot("pressed")) > 0.005, "a press must change the picture");
  await view.letGo();
  check((await view.state()).force_n === null, "the force must be null after the press is released");
  check((await view.events()).some(([name, detail]) => name === "press" && detail.force > 1), "no event `press`");

  await view.key("3");
  await view.hold([240, 385], [250, 330]);
  await view.rest();
  check(apart(side, await view.shot("pulled")) > OTHER, "a pull must change the picture");
  await view.letGo();

  await view.key("4");
  await view.hold([430, 385], [430, 470]);
  await view.letGo();
  await view.wait("a cut", (state) => state.status.startsWith("cut;"));
  await view.page.keyboard.down("Control");
  await view.key("r");
  await view.page.keyboard.up("Control");
  await view.rest();

  await view.click(810, 449);
  await view.rest();
  const clipped = await view.holdAgainst("clip", ALIKE);
  check(apart(side, clipped) > OTHER, "a clip must change the picture");
  await view.page.keyboard.down("Control");
  await view.key("z");
  await view.page.keyboard.up("Control");
  await view.rest();
  check(apart(await view.holdAgainst("undone", ALIKE), clipped) > OTHER, "undo must change the picture");

  await view.hold([900, 120], [900, 215]);
  await view.letGo();
  const clear = await view.holdAgainst("clear", ALIKE);
  check(apart(side, clear) > OTHER, "a dragged point of the transfer function must change the picture");
  await view.page.close();
}

/** Files opened by ?load= match the pictures of the command; files that cannot be opened are reported. */
async function files() {
  const view = await Page.open(browser, `${at}/?load=data/limb.vtu`);
  const open = await view.wait("the mesh", (state) => state.tets > 0 && state.pictures > 0);
  check(open.name === "limb.vtu", JSON.stringify(open));
  const size = [480, 360];
  const scene = path.join(OUT, "limb.toml");
  const camera = Object.entries(CAMERA).map(([name, value]) => `${name} = ${JSON.stringify(value)}`).join("\n");
  fs.writeFileSync(scene, `[mesh]\nfile = "${path.join(ROOT, "data/limb.vtu")}"\n[camera]\n${camera}\n`);
  const native = drawn(scene, path.join(OUT, "command.png"), size);
  await view.call("camera", CAMERA);
  const off = apart(native, await view.picture("element", ...size));
  console.log(`screenshot(): differs from the command's by ${(255 * off).toFixed(3)}/255`);
  check(off <= SAME, `the picture differs from the command's by ${255 * off}/255, at most ${255 * SAME}; see ${OUT}`);
  // Verify that the comparison detects differences.
  await view.call("camera", { ...CAMERA, fov: 24 });
  const other = apart(native, await view.picture("other", ...size));
  check(other > SAME, `a picture of another camera must differ from the command's, but only does by ${255 * other}/255`);

  // The old names of methods and of the state still work, each with one warning.
  const pairs = await view.page.evaluate(async () => {
    const view = document.querySelector("palpate-view");
    await view.put("note.txt", new Uint8Array([1]));
    await view.put("note.txt", new Uint8Array([2]));
    const sizes = [(await view.picture(32, 24)).size, (await view.screenshot(32, 24)).size];
    const state = view.state();
    return [sizes, [state.said, state.status], [state.lost, state.deviceLost], [state.opened, state.loadCount]];
  });
  for (const [old, current] of pairs) check(old === current && old !== undefined, JSON.stringify(pairs));
  for (const [old, current] of [["put()", "addFile()"], ["picture()", "screenshot()"], ["state().said", "state().status"],
    ["state().lost", "state().deviceLost"], ["state().opened", "state().loadCount"]]) {
    const warnings = view.said.filter((line) => line.includes(`palpate-view: ${old} is now ${current}`));
    check(warnings.length === 1 && warnings[0].startsWith("warn"), `${old}: ${JSON.stringify(view.said)}`);
  }

  await view.drop([["dropped.vtu", file("ball.vtu")]]);
  await view.wait("the dropped mesh", (state) => state.name === "dropped.vtu");
  const text = '[mesh]\nfile = "ball.vtu"\n[picture]\ntransfer = "tissue"\n';
  await view.drop([["ball.vtu", file("ball.vtu")], ["ball.toml", text]]);
  const dropped = await view.wait("the dropped scene", (state) => state.name === "ball.toml");
  check(!dropped.error, JSON.stringify(dropped));

  await view.events();
  const broken = {
    "bad.vtu": [1, 2, 3],
    "short.vtu": [...file("ball.vtu").subarray(0, 5000)],
    "nothing.stl": [],
    "noise.nrrd": [...file("limb.json")],
    "bad.toml": [...Buffer.from("[mesh]\nfil = 3\n")],
    "what.xyz": [1, 2, 3],
  };
  for (const [name, bytes] of Object.entries(broken)) {
    const why = await view.page.evaluate(async (name, bytes) => {
      const view = document.querySelector("palpate-view");
      return view.load(new Uint8Array(bytes), name).then(() => "", (why) => why.message);
    }, name, bytes);
    check(why.includes(name), `load() of ${name} must reject with a message that names it: ${JSON.stringify(why)}`);
    const said = await view.wait("an error", (state) => state.error);
    check(said.status.includes(name) && said.name === "ball.toml", JSON.stringify(said));
    await hear(view, name);
    console.log(`  ${why}`);
  }
  await view.drop([["dropped.vtu", "<VTKFile>"]]);
  await view.wait("the error of the dropped file", (state) => state.error && state.status.includes("dropped.vtu"));
  await view.events();
  await view.page.evaluate(() => document.querySelector("palpate-view").setAttribute("src", "none.vtu"));
  await view.wait("the error of a missing file", (state) => state.error && state.status.includes("404"));
  await hear(view, "none.vtu: 404");
  await view.shot("bad", true);

  // A valid file opens after these errors.
  await view.call("load", `${at}/data/ball.vtu`);
  const ball = await view.state();
  check(!ball.error && ball.name === "ball.vtu", JSON.stringify(ball));
  await view.page.close();
}

/** At rest, light paths set in over the local light, with the surface of a tool; motion ends them. */
async function paths() {
  const view = await Page.open(browser, `${at}/?load=data/ball.vtu`);
  await view.page.setViewport({ width: 600, height: 360 });
  await view.wait("the mesh", (state) => state.name === "ball.vtu");
  const scene = (light) => `[mesh]\nfile = "ball.vtu"\n[picture]\ntransfer = "tissue"\n${light}[solver]\n` +
    'name = "implicit"\ngravity = [0.0, 0.0, 0.0]\n[[pin]]\naxis = "z"\nbelow = 0.1\n' +
    "[[tool]]\nsphere = { radius = 0.015 }\nat = [0.0, -0.04, 0.05]\n";
  const open = async (name, light) => {
    await view.drop([["ball.vtu", file("ball.vtu")], [name, scene(light)]]);
    const state = await view.wait("the scene", (state) => state.error || (state.name === name && !state.loading));
    check(!state.error, state.status);
  };
  await open("local.toml", "");
  await view.rest();
  const local = await view.shot("local");
  await open("paths.toml", '[light]\nmodel = "path"\nsamples = 2\n');
  await view.wait("light paths", (state) => state.light_path_samples === 2);
  const lit = await view.shot("paths");
  check(apart(local, lit) > OTHER, "light paths must change the picture");
  await view.call("camera", { eye: [0.2, -0.1, 0.1], look_at: [0, 0, 0], up: [0, 0, 1], fov: 40 });
  await view.wait("the local light", (state) => state.light_path_samples === null);
  await view.wait("light paths after a motion", (state) => state.light_path_samples === 2);
  check(apart(lit, await view.shot("turned")) > OTHER, "light paths must follow the camera");
  await view.page.close();
}

/** Repeated presses and camera changes through the element need no more memory than the first ones. */
async function use() {
  const view = await Page.open(browser, `${at}/?example=limb`);
  await view.wait("a picture", (state) => state.pictures > 0);
  const memory = [];
  for (let n = 0; n < 6; n++) {
    const began = await view.state();
    const since = Date.now();
    await view.call("press", 0.35, 0.55, 0.004);
    const pressed = await view.wait("a force", (state) => state.depth_m > 0.003 || state.steps > began.steps + 30);
    check(pressed.force_n > 0, JSON.stringify(pressed));
    const steps = pressed.steps - began.steps;
    if (n === 0) console.log(`time per step of a press with its frame: ${((Date.now() - since) / steps).toFixed(0)} ms`);
    await view.call("release");
    for (let k = 0; k < 3; k++) {
      const { pictures } = await view.state();
      await view.call("camera", { ...CAMERA, fov: 20 + k });
      await view.wait("another picture", (state) => state.pictures > pictures);
    }
    await view.wait("the end of the press", (state) => state.force_n === null);
    memory.push((await view.state()).memory_mb);
  }
  console.log(`memory of the module: ${memory.map((mb) => mb.toFixed(0)).join(", ")} MB`);
  // Ten times the variation between rounds.
  check(memory.at(-1) <= memory[1] + 80, `memory grows: ${memory} MB`);
  await view.page.close();
}

/** A phone in portrait orientation. */
async function phone() {
  const view = await Page.open(browser, `${at}/?example=limb`);
  await view.page.setViewport({ width: 390, height: 760, isMobile: true, hasTouch: true });
  await view.page.reload();
  await view.wait("a picture", (state) => state.pictures > 0);
  await view.rest();
  const wide = await view.page.evaluate(() => document.documentElement.scrollWidth);
  check(wide <= 390, `the page must fit a phone of 390 pixels, but is ${wide} wide`);
  await view.holdAgainst("phone", ALIKE, true);
  const before = (await view.state()).camera;
  await view.page.touchscreen.touchStart(200, 300);
  for (let n = 1; n <= 8; n++) await view.page.touchscreen.touchMove(200 + 10 * n, 300);
  await view.page.touchscreen.touchEnd();
  await view.wait("a camera change by touch", ({ camera }) => JSON.stringify(camera) !== JSON.stringify(before));
  await view.page.close();
}

/** The page reports a lost device, and can restart the viewer. */
async function lost() {
  const view = await Page.open(browser, `${at}/?example=limb`);
  await view.wait("a picture", (state) => state.pictures > 0);
  await view.events();
  const session = await browser.target().createCDPSession();
  session.send("Browser.crashGpuProcess").catch(() => {});
  await view.wait("the loss", (state) => state.error);
  const said = await view.page.evaluate(() => document.querySelector("palpate-view").shadowRoot.textContent);
  check(said.includes("lost the graphics device"), said);
  await hear(view, "lost the graphics device");
  const refused = await view.page.evaluate(() =>
    document.querySelector("palpate-view").press(0.5, 0.5, 0.01).then(() => "", (why) => why.message));
  check(refused.includes("lost"), `press() without a device must report the loss, but says "${refused}"`);
  await view.shot("lost");
  // Restarting the GPU process of the browser may take a while: retry until the viewer works. The button loads
  // the page again, which ends what runs in it.
  const unlessLeft = (why) => {
    if (!/detached Frame|context was destroyed/.test(why.message)) throw why;
  };
  for (let tries = 0; ; tries++) {
    await sleep(2000);
    await view.page.evaluate(() => document.querySelector("palpate-view").shadowRoot.querySelector("button")?.click()).catch(unlessLeft);
    await sleep(2000);
    const state = await view.state().catch(unlessLeft);
    if (state?.pictures > 0 && !state.error) break;
    check(tries < 30, "the viewer does not restart after 30 tries");
  }
  await view.page.close();
}

/** The page reports a panic of the viewer. */
async function ended() {
  const view = await Page.open(browser, `${at}/?example=limb`);
  await view.wait("a picture", (state) => state.pictures > 0);
  await view.page.evaluate(async () => {
    const { Viewer } = await import("./palpate_view.js");
    const canvas = document.body.appendChild(document.createElement("canvas"));
    const viewer = new Viewer();
    // Destroying a viewer within its own frame panics.
    viewer.start(canvas, undefined, () => viewer.destroy(), () => {}).catch(() => {});
  });
  const state = await view.wait("the end", (state) => state.error);
  check(state.status.includes("reload the page"), state.status);
  await view.shot("ended", true);
  await view.page.close();
}

/** The page reports missing WebGPU or a missing device. */
async function without() {
  const old = await launch({ webgpu: false, size: [640, 400] });
  const said = async (name, prepare) => {
    const view = await Page.open(old, `${at}/`, prepare);
    const state = await view.wait("the error message", (state) => state.error);
    const shown = await view.page.evaluate(() => {
      const alert = document.querySelector("palpate-view").shadowRoot.querySelector("[role=alert]");
      return alert?.offsetHeight > 0 ? alert.innerText : "";
    });
    check(shown.includes(state.status), `the page must show "${state.status}", but shows "${shown}"`);
    await view.shot(name, true);
    return shown;
  };
  try {
    const none = await said("without_device");
    check(none.includes("requires WebGPU, but this browser finds no supported graphics device"), none);
    const old = await said("without", () => {
      Object.defineProperty(Navigator.prototype, "gpu", { get: () => undefined });
    });
    check(old.includes("requires WebGPU, which this browser does not support"), old);
  } finally {
    await old.close();
  }
}

const PARTS = { session, files, paths, use, phone, lost, ended, without };
const wanted = process.argv.slice(2);
try {
  browser = await launch();
  for (const [name, run] of Object.entries(PARTS)) {
    if (wanted.length && !wanted.includes(name)) continue;
    await part(name, run).catch((why) => again(name, run, why));
  }
  console.log(`page: all tests passed; screenshots are in ${OUT}`);
} finally {
  await browser?.close();
  server.close();
}
