// SPDX-License-Identifier: Apache-2.0
/** A reporter of node's test runner: a line of JSON for each test that failed. Called by again.ts. */

type Event = { type: string; data: { name: string; file?: string; nesting: number } };

export default async function* failed(events: AsyncIterable<Event>): AsyncGenerator<string> {
  for await (const { type, data } of events)
    if (type === "test:fail" && data.nesting === 0) yield `${JSON.stringify({ name: data.name, file: data.file ?? data.name })}\n`;
}
