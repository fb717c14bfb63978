// SPDX-License-Identifier: Apache-2.0
/** An estimate and a reflection map of a live daemon, as they came to a page of its own. */
import type { Browser } from "playwright-core";
import { decode, encodeSubscription } from "../src/index.js";
import { DEFAULT_SUBSCRIPTION, type ReflectionMapWish } from "../src/wire.js";

export async function packets(browser: Browser, port: number, reflectionMap: ReflectionMapWish): Promise<{ estimate: number[]; map: number[] }> {
  const page = await browser.newPage();
  await page.goto(`http://127.0.0.1:${port}/style.css`); // the probe's own origin, and no other client in it
  const request = [...encodeSubscription({ ...DEFAULT_SUBSCRIPTION, reflectionMap }, 1)];
  const received = await page.evaluate(({ where, request }) => new Promise<number[][]>((done) => {
    const socket = new WebSocket(`ws://127.0.0.1:${where}/`, "lightprobe.v1"), messages: number[][] = [];
    socket.binaryType = "arraybuffer";
    socket.onopen = () => socket.send(new Uint8Array(request));
    socket.onmessage = ({ data }: MessageEvent<ArrayBuffer>) => {
      messages.push([...new Uint8Array(data)]);
      if (data.byteLength > 5000) done(messages); // a map
    };
  }), { where: port, request });
  await page.close();
  const newest = (kind: string): number[] => received.filter((bytes) => decode(Uint8Array.from(bytes))?.kind === kind).at(-1)!;
  return { estimate: newest("estimate"), map: newest("reflectionMap") };
}
