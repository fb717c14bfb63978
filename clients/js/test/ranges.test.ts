// SPDX-License-Identifier: Apache-2.0
/** Every number at and beyond the ends of its line in proto/ranges.toml: the same cases as of the other clients. */
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { resolve } from "node:path";
import { test } from "node:test";
import { WireError, decode } from "../src/wire.js";
import { ROOT } from "./golden.js";

const printed = execFileSync(resolve(ROOT, "build/venv/bin/python"), [resolve(ROOT, "tests/unit/range_cases.py")], { maxBuffer: 1 << 28 });
const cases = JSON.parse(printed.toString()) as [name: string, hex: string, refusal: string | null][];

test("there are cases", () => assert.ok(cases.length > 300));

for (const [name, hex, refusal] of cases)
  test(`${refusal ? "refused" : "taken"}: ${name}`, () => {
    const data = new Uint8Array(Buffer.from(hex, "hex"));
    if (refusal) assert.throws(() => decode(data), (error) => error instanceof WireError && error.message === refusal);
    else decode(data);
  });
