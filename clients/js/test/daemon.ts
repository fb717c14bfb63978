// SPDX-License-Identifier: Apache-2.0
/** The daemon, and what it looks at, for tests with a live one. */
import { spawn, type ChildProcess } from "node:child_process";
import { once } from "node:events";
import { mkdtempSync, writeFileSync } from "node:fs";
import { createServer } from "node:http";
import { connect } from "node:net";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
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

/** The colour of the room around each axis, +X −X +Y −Y +Z −Z, in {@link axesPanorama}. */
export const AXIS_COLOURS: readonly [number, number, number][] = [[1, 0.1, 0.1], [0.1, 1, 0.1], [0.1, 0.1, 1], [1, 1, 0.1], [0.1, 1, 1], [1, 0.1, 1]];

/** A 32-bit float panorama whose direction is unmistakable: a disc of 28° of its own colour around each axis, in a grey room. */
export function axesPanorama(): Buffer {
  const width = 256, height = 128, data = new Float32Array(3 * width * height);
  for (let row = 0; row < height; row++)
    for (let column = 0; column < width; column++) {
      const polar = (Math.PI * (row + 0.5)) / height, around = 2 * Math.PI * ((column + 0.5) / width - 0.5);
      const direction = [Math.sin(polar) * Math.sin(around), Math.cos(polar), -Math.sin(polar) * Math.cos(around)];
      const along = direction.flatMap((value) => [value, -value]), axis = along.indexOf(Math.max(...along));
      data.set(along[axis]! > Math.cos((28 * Math.PI) / 180) ? AXIS_COLOURS[axis]! : [0.3, 0.3, 0.3], 3 * ((height - 1 - row) * width + column));
    }
  return Buffer.concat([Buffer.from(`PF\n${width} ${height}\n-1.0\n`), Buffer.from(data.buffer)]);
}

export const WEB = resolve(ROOT, "build/web");

/** A daemon that looks at panorama() and serves the viewer; it may be stopped, and started again on the same port. */
export class LiveDaemon {
  readonly folder = mkdtempSync(join(tmpdir(), "lp-web-"));
  port = 0;
  program = DAEMON;
  /** What it looks at. */
  picture = panorama();
  /** Instead of the picture: the daemon's --source. */
  source: string | undefined;
  #process: ChildProcess | undefined;

  /** `publish`: the option's value for a port. Resolves when it listens. */
  async start(publish = (port: number): string => `ws:127.0.0.1:${port}?root=${WEB}`, ...more: string[]): Promise<this> {
    const before = this.#process;
    // One that was killed listens until it is gone.
    if (before && before.exitCode === null && before.signalCode === null) await once(before, "exit");
    writeFileSync(join(this.folder, "room.pfm"), this.picture);
    this.port ||= await freePort();
    this.#process = spawn(this.program, [`--source=${this.source ?? `file:${join(this.folder, "room.pfm")}?rate=30`}`, `--publish=${publish(this.port)}`,
      "--name=test room", "--reflection-map=32", "--ttl-ms=600000", ...more], { stdio: ["ignore", "ignore", "inherit"] });
    for (let left = 600; !(await this.#isListening()); left--) {
      if (left === 0 || this.#process.exitCode !== null) throw new Error("the daemon does not listen");
      await new Promise((done) => setTimeout(done, 100));
    }
    return this;
  }

  /** Ends it without a word to its clients. */
  kill(): void {
    this.#process?.kill("SIGKILL");
  }

  #isListening(): Promise<boolean> {
    return new Promise((done) => {
      const socket = connect(this.port, "127.0.0.1", () => { socket.destroy(); done(true); });
      socket.on("error", () => done(false));
    });
  }
}
