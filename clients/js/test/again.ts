// SPDX-License-Identifier: Apache-2.0
/**
 * Runs test files; one or two tests that failed are named and run once more, alone: on a busy machine a page or a daemon may get no
 * processor in time. More are no accident. `node again.js FILE…`; the status is node's. Rule and number as in tests/again.py.
 */
import { spawnSync } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { fileURLToPath } from "node:url";

const MOST = 2, LOOKS_LIKE_A_PATTERN = /[.*+?^${}()|[\]\\]/g;
const folder = mkdtempSync(join(tmpdir(), "lp-again-")), list = join(folder, "failed");

type Failed = { name: string; file: string };

/** Runs tests of files, all or those of some names; what failed, with node's status. */
function run(files: string[], names: string[] = []): { status: number; failed: Failed[] } {
  const { status } = spawnSync(process.execPath, [
    "--test", "--test-reporter=tap", "--test-reporter-destination=stdout",
    `--test-reporter=${fileURLToPath(new URL("failed.js", import.meta.url))}`, `--test-reporter-destination=${list}`,
    ...names.map((name) => `--test-name-pattern=^${name.replace(LOOKS_LIKE_A_PATTERN, "\\$&")}$`), ...files,
  ], { stdio: "inherit" });
  const failed = readFileSync(list, "utf8").split("\n").filter(Boolean).map((line) => JSON.parse(line) as Failed);
  return { status: status ?? 1, failed };
}

function main(files: string[]): number {
  const { status, failed } = run(files);
  if (status === 0) return 0;
  for (const { name } of failed) console.log(`tests: failed: ${name}`);
  if (failed.length === 0 || failed.length > MOST) {
    console.log(`tests: ${failed.length} failed: no second run (of 1 to ${MOST} only)`);
    return status;
  }
  console.log(`tests: ${failed.length} failed, and run once more, alone`);
  const again = [...new Set(failed.map(({ file }) => file))];
  // A file that failed as a whole has its path for a name: no test of it has that.
  return run(again, failed.some(({ name, file }) => name === file) ? [] : failed.map(({ name }) => name)).status;
}

try {
  process.exitCode = main(process.argv.slice(2));
} finally {
  rmSync(folder, { recursive: true, force: true });
}
