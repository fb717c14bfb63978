// SPDX-License-Identifier: Apache-2.0
/** The objects on the floor of the room, by WebXR's immersive-ar, where the browser and the device have it. */
import type { WebGLRenderer } from "three";

/** The middle of the row of balls stands so far ahead on the floor. */
const AHEAD_M = 2.5;

export async function isXrOffered(): Promise<boolean> {
  try {
    return (await navigator.xr?.isSessionSupported("immersive-ar")) ?? false;
  } catch {
    return false; // a page that may not ask
  }
}

/**
 * Starts a session; `ended` is called when it is over, however that comes. Forward (−Z) is where the user looks at this moment: that
 * should be where the probe looks. Rejects with what the browser says.
 */
export async function startXr(renderer: WebGLRenderer, ended: () => void): Promise<void> {
  const session = await navigator.xr!.requestSession("immersive-ar", { requiredFeatures: ["local-floor"] });
  session.addEventListener("end", () => {
    renderer.xr.enabled = false;
    ended();
  });
  renderer.xr.enabled = true;
  renderer.xr.setReferenceSpaceType("local-floor");
  try {
    await renderer.xr.setSession(session);
    const floor = await session.requestReferenceSpace("local-floor");
    renderer.xr.setReferenceSpace(floor.getOffsetReferenceSpace(new XRRigidTransform({ x: 0, y: 0, z: -AHEAD_M })));
  } catch (error) {
    await session.end();
    throw error;
  }
}
