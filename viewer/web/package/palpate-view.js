// <palpate-view src="liver.vtu" transfer="tissue">: the viewer as a page element.

import init, { Viewer } from "./palpate_view.js";

const WASM = new URL("palpate_view_bg.wasm", import.meta.url);
const NO_WEBGPU =
  "This page requires WebGPU, which this browser does not support or has disabled. " +
  "Chrome and Edge support it from version 113, Safari from 26 and Firefox from 141; " +
  "on Linux it may have to be enabled.";
const NOT_SECURE =
  "This page requires WebGPU, which browsers provide only to secure pages: " +
  "open it over https or from localhost.";
const NO_ADAPTER =
  "This page requires WebGPU, but this browser finds no supported graphics device. " +
  "Enable graphics acceleration in its settings, or update the graphics driver.";
const LOST =
  "The browser lost the graphics device, and with it the state of the body.";
const ENDED = "Internal error: the viewer stopped; reload the page to restart it.";
const STYLE =
  ":host { display: block; position: relative; min-height: 200px } " +
  "canvas { position: absolute; inset: 0; width: 100%; height: 100%; touch-action: none; outline: none } " +
  "div { font: 16px/1.5 sans-serif; max-width: 40em; margin: 2em auto; padding: 0 1em; color: #999 } " +
  "button { font: inherit; padding: 0.3em 1em }";

/** Names of the log of frames, and those of the state. */
const STATE_NAMES = { said: "status", lost: "deviceLost", opened: "loadCount" };

const warned = new Set();

/** Warns of the use of an old name, once. */
function warnOfOldName(old, current) {
  if (warned.has(old)) return;
  warned.add(old);
  console.warn(`palpate-view: ${old} is now ${current}; the old name still works`);
}

/** Returns the state of a frame; its old names are not enumerable. */
function stateOf(frame) {
  const state = {};
  for (const [name, value] of Object.entries(frame)) state[STATE_NAMES[name] ?? name] = value;
  for (const [old, current] of Object.entries(STATE_NAMES)) {
    const get = () => {
      warnOfOldName(`state().${old}`, `state().${current}`);
      return state[current];
    };
    Object.defineProperty(state, old, { get });
  }
  return state;
}

let module;

/** Fetches and compiles the module, once for all elements. */
function ready() {
  module ??= init({ module_or_path: WASM }).catch((why) => {
    module = undefined;
    throw new Error(`${WASM.href}: ${why.message ?? why}`);
  });
  return module;
}

/** Fetches the bytes at a URL; errors name the URL. */
async function fetched(url) {
  const answer = await fetch(url).catch((why) => {
    throw new Error(`${url}: ${why.message}; a server of another origin must allow the request (CORS)`);
  });
  if (!answer.ok) throw new Error(`${url}: ${answer.status} ${answer.statusText}`);
  return new Uint8Array(await answer.arrayBuffer());
}

async function bytesOf(what) {
  if (what instanceof Uint8Array) return what;
  if (what instanceof ArrayBuffer) return new Uint8Array(what);
  if (what instanceof Blob) return new Uint8Array(await what.arrayBuffer());
  return fetched(what);
}

export class PalpateView extends HTMLElement {
  static observedAttributes = ["src", "transfer"];

  #viewer;
  #shown;
  #last = {};
  #ended;
  #wanted = Promise.resolve();
  #waits;

  connectedCallback() {
    if (!this.#shown) this.#start();
  }

  disconnectedCallback() {
    this.#end();
  }

  attributeChangedCallback(name, before, now) {
    if (before !== now && this.#shown) this.#open();
  }

  #start() {
    const root = this.shadowRoot ?? this.attachShadow({ mode: "open" });
    root.innerHTML =
      `<style>${STYLE}</style><canvas tabindex="0" aria-label="Interactive view of a body"></canvas>`;
    this.#last = {};
    this.#ended = undefined;
    const shown = this.#begin(root.querySelector("canvas"), () => this.#shown === shown);
    this.#shown = shown;
    shown.catch((why) => this.#shown === shown && this.#stop(why?.message ?? String(why)));
    this.#open();
  }

  /** Starts a viewer on `canvas`, and stops it if it is no longer `wanted`. */
  async #begin(canvas, wanted) {
    if (!navigator.gpu) throw new Error(window.isSecureContext ? NO_WEBGPU : NOT_SECURE);
    const [adapter] = await Promise.all([navigator.gpu.requestAdapter(), ready()]);
    if (!adapter) throw new Error(NO_ADAPTER);
    const viewer = new Viewer();
    const example = this.getAttribute("src") ? undefined : (this.getAttribute("example") ?? undefined);
    // Deferred until after the frame, because listeners may call the viewer.
    const told = (text) => queueMicrotask(() => this.#viewer === viewer && this.#told(JSON.parse(text)));
    const ended = (why) => {
      console.error(why);
      queueMicrotask(() => wanted() && this.#stop(ENDED));
    };
    await viewer.start(canvas, example, told, ended);
    if (!wanted()) return viewer.destroy();
    this.#viewer = viewer;
  }

  /** Frees the canvas and the device, and rejects a pending load. */
  #end(why = "the element was removed from the page") {
    const viewer = this.#viewer;
    this.#viewer = undefined;
    this.#shown = undefined;
    this.#settle(new Error(why));
    try {
      viewer?.destroy();
    } catch {
      // A module that has panicked cannot be called.
    }
  }

  /** Replaces the picture by an error message; `again` adds a button to restart the viewer. */
  #stop(message, again = false) {
    this.#end(message);
    this.#ended = message;
    const said = document.createElement("div");
    said.setAttribute("role", "alert");
    said.append(Object.assign(document.createElement("p"), { textContent: message }));
    if (again) {
      const button = Object.assign(document.createElement("button"), { textContent: "Restart viewer" });
      button.addEventListener("click", () => this.#start());
      said.append(button);
    }
    this.shadowRoot.querySelector("canvas")?.replaceWith(said);
    this.#tell("error", { message });
  }

  #open() {
    const src = this.getAttribute("src");
    // The viewer reports errors itself.
    if (src) this.load(new URL(src, document.baseURI).href).catch(() => {});
  }

  #tell(name, detail) {
    this.dispatchEvent(new CustomEvent(name, { detail }));
  }

  /** Compares a frame with the previous one, and dispatches events of the changes. */
  #told(frame) {
    const last = this.#last;
    this.#last = frame;
    if (frame.lost !== null) return this.#stop(`${LOST} Reason: ${frame.lost || "unknown"}`, true);
    if (frame.opened > (last.opened ?? 0)) this.#tell("load", { name: frame.name, tets: frame.tets });
    if (frame.error && !(last.error && frame.said === last.said)) this.#tell("error", { message: frame.said });
    if (this.#waits) this.#look();
    if (frame.force_n !== null && frame.force_n !== last.force_n) {
      this.#tell("press", { force: frame.force_n, depth: frame.depth_m });
    }
    if (JSON.stringify(frame.camera) !== JSON.stringify(last.camera)) this.#tell("camera", this.camera());
  }

  /** Settles the pending load, once its file is open or has failed. */
  #look() {
    // The reported frame may be older than the pending load.
    const frame = this.#frame();
    if (frame.loading) return;
    this.#settle(frame.opened > this.#waits.opened ? undefined : new Error(frame.said));
  }

  /** Resolves the pending load, or rejects it with the error `why`. */
  #settle(why) {
    const waits = this.#waits;
    this.#waits = undefined;
    if (why) waits?.reject(why);
    else waits?.resolve();
  }

  async #ready() {
    if (this.#ended) throw new Error(this.#ended);
    await this.#shown;
    if (!this.#viewer) throw new Error("the element is not attached to a page");
    return this.#viewer;
  }

  /** Opens a URL, a File, or bytes with a name; resolves once it is shown. */
  load(what, name) {
    this.#wanted = this.#wanted.catch(() => {}).then(() => this.#load(what, name));
    return this.#wanted;
  }

  async #load(what, name) {
    const viewer = await this.#ready();
    // A repeated error is reported again.
    this.#last = { ...this.#last, error: false };
    const bytes = await bytesOf(what).catch((why) => {
      this.#viewer?.say(why.message);
      throw why;
    });
    if (this.#viewer !== viewer) throw new Error("the element was removed from the page");
    const called = name ?? what.name ?? decodeURIComponent(String(what).split(/[?#]/)[0].split("/").pop());
    viewer.add_file(called, bytes);
    const { opened } = this.#frame();
    const shown = new Promise((resolve, reject) => (this.#waits = { resolve, reject, opened }));
    viewer.open(called, this.getAttribute("transfer") ?? undefined);
    return shown;
  }

  /** Stores a file in memory, for scenes that refer to it. */
  async addFile(name, bytes) {
    (await this.#ready()).add_file(name, await bytesOf(bytes));
  }

  /** Old name of `addFile`. */
  put(name, bytes) {
    warnOfOldName("put()", "addFile()");
    return this.addFile(name, bytes);
  }

  /** Returns the camera, after setting it to `camera` if given. */
  camera(camera) {
    if (!this.#viewer) return undefined;
    if (camera) this.#viewer.set_camera(JSON.stringify(camera));
    return JSON.parse(this.#viewer.camera());
  }

  /** Presses on the body at x, y (0 to 1, to the right and down), to `depth` metres. */
  async press(x, y, depth) {
    (await this.#ready()).press(x, y, depth);
  }

  /** Retracts the finger. */
  async release() {
    (await this.#ready()).release();
  }

  /** Renders the picture as a PNG. */
  async screenshot(width = 1024, height = 768) {
    const bytes = await (await this.#ready()).screenshot(width, height);
    return new Blob([bytes], { type: "image/png" });
  }

  /** Old name of `screenshot`. */
  picture(width, height) {
    warnOfOldName("picture()", "screenshot()");
    return this.screenshot(width, height);
  }

  /** Returns the log record of the last frame. */
  state() {
    return stateOf(this.#frame());
  }

  /** Returns the last frame, with the names of the log. */
  #frame() {
    if (this.#ended) return { said: this.#ended, error: true };
    return this.#viewer ? JSON.parse(this.#viewer.state()) : {};
  }
}

customElements.define("palpate-view", PalpateView);
