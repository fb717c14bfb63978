// SPDX-License-Identifier: Apache-2.0
/** Prints, as JSON, how long an app's update takes for one, two and three objects: what `make seen` puts into its page. */
import { launch, pageWith } from "./chromium.js";
import { LiveDaemon } from "./daemon.js";
import { packets } from "./packets.js";

const ROUNDS = Number(process.env["ROUNDS"] ?? 10);

const daemon = await new LiveDaemon().start(), browser = await launch();
try {
  const { estimate, map } = await packets(browser, daemon.port, { size: 32, rateHz: 30, kind: "AMBIENT" }), page = await pageWith(browser, "updates.ts");
  type Updates = { updates: (...all: unknown[]) => { cubeMs: number; localMs: number } };
  const times = [];
  for (const objects of [1, 2, 3])
    times.push({ objects, ...await page.evaluate(([a, b, n, rounds]) => (window as unknown as Updates).updates(a, b, n, rounds), [estimate, map, objects, ROUNDS] as const) });
  console.log(JSON.stringify(times));
} finally {
  await browser.close();
  daemon.kill();
}
