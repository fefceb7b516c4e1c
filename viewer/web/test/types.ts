// Checks the element's TypeScript types; compiled by scripts/test page.

import { type Camera } from "../package/palpate-view.js";

const view = document.querySelector("palpate-view")!;
view.addEventListener("press", (event) => event.detail.force.toFixed(event.detail.depth));
view.addEventListener("load", (event) => event.detail.name.length + event.detail.tets);
view.addEventListener("error", (event) => event.detail.message.length);
view.addEventListener("camera", (event) => event.detail.eye[2]);
view.addEventListener("click", (event) => event.clientX);

export async function use(): Promise<Blob> {
  await view.addFile("knee.json", new Uint8Array(3));
  await view.load(new File([], "knee.nrrd"));
  await view.load(new ArrayBuffer(3), "knee.nrrd");
  const camera: Camera | undefined = view.camera();
  view.camera({ ...camera, eye: [0, 0, 1], look_at: [0, 0, 0], up: [0, 1, 0], fov: 30 });
  await view.press(0.5, 0.5, 0.01);
  await view.release();
  const { force_n: force, status, deviceLost, loadCount } = view.state();
  const lines: (string | null | undefined)[] = [status, deviceLost, loadCount?.toFixed()];
  view.title = lines.join();
  // The old names are still there.
  await view.put("knee.json", new Uint8Array(3));
  await view.picture(8, 6);
  view.title = [view.state().said, view.state().lost, view.state().opened].join();
  // @ts-expect-error: a press requires a depth
  await view.press(0.5, force ?? 0);
  return view.screenshot(800, 600);
}
