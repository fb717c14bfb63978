// SPDX-License-Identifier: Apache-2.0
/** Whether a message holds what proto/ranges.toml allows. The table is generated from it, in gen/ranges.ts. */

import { RANGES, UNIT_TOLERANCE } from "./gen/ranges.js";

/** One field's line; its keys are explained in the table. */
export interface Range {
  field: string;
  least?: number;
  most?: number;
  above?: number;
  /** Of a list or of bytes, the product of these. */
  count?: (number | { plus: number; of: string })[];
  unit?: boolean;
  absent?: boolean;
  nan?: boolean;
  oneOf?: number[];
  required?: boolean;
  /** What is said of a number that is out of it. */
  refusal: string;
}

interface Part {
  $typeName: string;
}

const isPart = (value: unknown): value is Part => typeof value === "object" && value !== null && "$typeName" in value;

/** Which field of a message, or of one in it, is out of its range; undefined: none is. */
export function broken(message: Part): string | undefined {
  const values = message as unknown as Record<string, unknown>;
  for (const range of RANGES[message.$typeName] ?? []) if (!keeps(values, range)) return range.refusal;
  for (const value of Object.values(values))
    for (const inner of Array.isArray(value) ? (value as unknown[]) : [value]) {
      const sentence = isPart(inner) ? broken(inner) : undefined;
      if (sentence) return sentence;
    }
  return undefined;
}

function keeps(message: Record<string, unknown>, range: Range): boolean {
  const value = message[range.field];
  if (value === undefined) return !range.required;
  if (range.required) return true;
  if (range.oneOf) return range.oneOf.includes(value as number);
  if (!range.count) return isInside(value as number, range);
  const list = value as number[] | Uint8Array;
  if (range.absent && !list.length) return true;
  const count = range.count.reduce<number>((product, one) => product * (typeof one === "number" ? one : one.plus + (message[one.of] as number)), 1);
  if (list.length !== count) return false;
  if (list instanceof Uint8Array) return true;
  if (range.unit && !(Math.abs(Math.hypot(...list) - 1) <= UNIT_TOLERANCE)) return false;
  return list.every((one) => isInside(one, range));
}

function isInside(value: number, { least = -Infinity, most = Infinity, above = -Infinity, nan = false }: Range): boolean {
  return Number.isNaN(value) ? nan : Number.isFinite(value) && value >= least && value <= most && value > above;
}
