// SPDX-License-Identifier: Apache-2.0
/** The daemon, and what it looks at, for tests with a live one. */
import { createServer } from "node:http";
import { resolve } from "node:path";
import { ROOT } from "./golden.js";

export const DAEMON = resolve(ROOT, "build/release/bin/lightprobed");

/** A port that is free now. */
export const freePort = (): Promise<number> => new Promise((done) => {
  const server = createServer().listen(0, "127.0.0.1", () => {
    const { port: found } = server.address() as { port: number };
    server.close(() => done(found));
  });
});

/** A 32-bit float panorama with a bright patch at elevation 45°, over a warm room; column 64: straight ahead, 96: to the right. */
export function panorama(lampColumn = 64): Buffer {
  const width = 128, height = 64, data = new Float32Array(3 * width * height);
  for (let row = 0; row < height; row++)
    for (let column = 0; column < width; column++) {
      const isLamp = Math.abs(row - 16) < 2 && Math.abs(column - lampColumn) < 2;
      // PFM's rows begin at the bottom.
      data.set(isLamp ? [400, 380, 300] : [0.5, 0.4, 0.3 + 0.2 * (row / height)], 3 * ((height - 1 - row) * width + column));
    }
  return Buffer.concat([Buffer.from(`PF\n${width} ${height}\n-1.0\n`), Buffer.from(data.buffer)]);
}
