/** A camera; lengths are in the units of the file that is open. */
export interface Camera {
  eye: [number, number, number];
  look_at: [number, number, number];
  up: [number, number, number];
  /** Degrees from the lowest ray to the highest; null where rays are parallel. */
  fov?: number | null;
  /** Height of what parallel rays show; null where they are not parallel. */
  orthographic?: number | null;
}

/** What is known of the last frame. Where there is none, because the viewer could not be shown or ended, `status` tells why. */
export interface State {
  /** What is open, and what is being opened. */
  name: string | null;
  loading: string | null;
  tets: number;
  steps: number;
  /** Iterations of the last step's linear solve. */
  iterations: number;
  pictures: number;
  /** Samples per pixel of the light paths that are shown; null for a picture in local light. */
  light_path_samples: number | null;
  /** Simulated time, s. */
  time_s: number;
  playing: boolean;
  /** Of a recorded series the frame that is shown, from 0. */
  series_frame: number | null;
  /** Of every plane a point and the normal; of a box its corners. */
  planes: number[][];
  /** Bodies that were opened so far. */
  loadCount: number;
  /** @deprecated Now `loadCount`. */
  readonly opened: number;
  /** Why the graphics device is gone; null while it is there. */
  deviceLost: string | null;
  /** @deprecated Now `deviceLost`. */
  readonly lost: string | null;
  /** Force of the press, N, and its depth, m. */
  force_n: number | null;
  depth_m: number | null;
  /** What the status line says, and whether that is an error. */
  status: string;
  /** @deprecated Now `status`. */
  readonly said: string;
  error: boolean;
  /** Since the frame before; what the interface, and a step of the body, took of that; and what of this
   * the driver took to take the drawing over, ms. */
  frame_ms: number;
  ui_ms: number;
  driver_ms: number;
  /** Memory of the module, MB; it never shrinks. */
  memory_mb: number | null;
  /** Eye, and what it looks at. */
  camera: [[number, number, number], [number, number, number]];
}

/** Its own events, all of them `CustomEvent`s with this `detail`. */
export interface PalpateViewEventMap extends Omit<HTMLElementEventMap, "load" | "error"> {
  /** A body is shown. */
  load: CustomEvent<{ name: string; tets: number }>;
  /** Something failed; `message` says what, where, and what to do. */
  error: CustomEvent<{ message: string }>;
  /** A step of a press: its force, N, and its depth, m. */
  press: CustomEvent<{ force: number; depth: number }>;
  /** The view is another one. */
  camera: CustomEvent<Camera>;
}

/**
 * `<palpate-view src="liver.vtu" transfer="tissue">`.
 *
 * Attributes: `src`, the address of a mesh, a volume, a closed surface or a scene; `example`, the name
 * of a body that ships (limb, knee, heart, head, foot, breast), shown where there is no `src` when the
 * element comes into the page; `transfer`, a preset of colours.
 *
 * Events: see `PalpateViewEventMap`. None of them bubbles.
 */
export class PalpateView extends HTMLElement {
  /**
   * Opens what an address, a File or bytes with a name hold. Ends once it is shown; rejects with what
   * is wrong with it, and what was open before still is. The name's ending says what it is.
   */
  load(what: string | Blob | ArrayBuffer | Uint8Array, name?: string): Promise<void>;
  /** Stores a file in memory, for scenes that refer to it. */
  addFile(name: string, bytes: string | Blob | ArrayBuffer | Uint8Array): Promise<void>;
  /** @deprecated Now `addFile`. */
  put(name: string, bytes: string | Blob | ArrayBuffer | Uint8Array): Promise<void>;
  /** The camera, once there is one; with one given, looks by it. */
  camera(camera?: Camera): Camera | undefined;
  /** Presses on what is seen at x, y (0 to 1, to the right and down), so many metres deep. */
  press(x: number, y: number, depth: number): Promise<void>;
  /** Takes the finger out again. */
  release(): Promise<void>;
  /** Renders the picture as a PNG. */
  screenshot(width?: number, height?: number): Promise<Blob>;
  /** @deprecated Now `screenshot`. */
  picture(width?: number, height?: number): Promise<Blob>;
  /** What is known of the last frame. */
  state(): Partial<State>;

  addEventListener<K extends keyof PalpateViewEventMap>(
    type: K,
    listener: (this: PalpateView, event: PalpateViewEventMap[K]) => void,
    options?: boolean | AddEventListenerOptions,
  ): void;
  addEventListener(
    type: string,
    listener: EventListenerOrEventListenerObject,
    options?: boolean | AddEventListenerOptions,
  ): void;
}

declare global {
  interface HTMLElementTagNameMap {
    "palpate-view": PalpateView;
  }
}
