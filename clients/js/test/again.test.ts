// SPDX-License-Identifier: Apache-2.0
/** again.ts on test files that fail once, always, or too often. */
import assert from "node:assert/strict";
import { spawnSync } from "node:child_process";
import { mkdtempSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, test } from "node:test";
import { fileURLToPath } from "node:url";

const folder = mkdtempSync(join(tmpdir(), "lp-again-test-"));
after(() => rmSync(folder, { recursive: true, force: true }));

/** Runs a file of tests: name and what each does; counts of runs are kept in files beside it. */
function ran(file: string, tests: Record<string, string>): { status: number | null; lines: string[] } {
  const path = join(folder, `${file}.mjs`);
  const count = 'const count = (name) => { const path = new URL(`${name}.count`, import.meta.url); fs.appendFileSync(path, "."); return fs.readFileSync(path).length; };';
  const body = Object.entries(tests).map(([name, does], i) => `test(${JSON.stringify(name)}, () => { const runs = count("${file}${i}"); ${does} });`);
  writeFileSync(path, ['import fs from "node:fs"; import test from "node:test";', count, ...body].join("\n"));
  const environment = { ...process.env };
  delete environment["NODE_TEST_CONTEXT"]; // it is a test of its own
  const { status, stdout } = spawnSync(process.execPath, [fileURLToPath(new URL("again.js", import.meta.url)), path], { encoding: "utf8", env: environment });
  return { status, lines: stdout.split("\n").filter((line) => line.startsWith("tests:")) };
}

const ONCE = 'if (runs === 1) throw new Error("no processor");', ALWAYS = 'throw new Error("wrong");', WELL = 'if (runs > 1) throw new Error("was run again");';

test("tests that fail once are named and run once more, alone, by their whole names", () =>
  assert.deepEqual(ran("once", { "a (b) [c] costs $1.5?": ONCE, "a (b) [c] costs $1.5? No": WELL, well: WELL }), { status: 0, lines: ["tests: failed: a (b) [c] costs $1.5?", "tests: 1 failed, and run once more, alone"] }));

test("one that fails twice has failed", () => assert.deepEqual(ran("always", { wrong: ALWAYS, well: WELL }), { status: 1, lines: ["tests: failed: wrong", "tests: 1 failed, and run once more, alone"] }));

test("three that fail are no accident", () => assert.deepEqual(ran("three", { a: ONCE, b: ONCE, c: ONCE }), { status: 1, lines: ["tests: failed: a", "tests: failed: b", "tests: failed: c", "tests: 3 failed: no second run (of 1 to 2 only)"] }));

test("where nothing fails nothing is said", () => assert.deepEqual(ran("well", { well: WELL }), { status: 0, lines: [] }));

test("a file that dies is run once more, whole", () => {
  const { status, lines } = ran("dies", { first: "", dies: "if (runs === 1) process.exit(3);" });
  assert.equal(status, 0);
  assert.equal(lines.at(-1), "tests: 1 failed, and run once more, alone");
});

test("a file that does not load is run once more, and has failed", () => {
  const { status, lines } = ran("broken", { broken: "}" });
  assert.equal(status, 1);
  assert.equal(lines.at(-1), "tests: 1 failed, and run once more, alone");
});
