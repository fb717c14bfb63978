// SPDX-License-Identifier: Apache-2.0
/**
 * Reads what `lightprobe record` writes: an MCAP file (https://mcap.dev) of a probe's messages. No DOM in this file.
 * A made-up chunk of 18 bytes holds the unpacking up for minutes, and another one for ever: a page calls this in a Worker (reader.ts).
 */
import { decompress } from "fzstd";

/** One message as it came, and when, from the first. */
export interface Recorded { timeMs: number; data: Uint8Array }

const MAGIC = [0x89, 0x4d, 0x43, 0x41, 0x50, 0x30, 0x0d, 0x0a];
const SCHEMA = 3, CHANNEL = 4, MESSAGE = 5, CHUNK = 6;
const OF_A_PROBE = "lightprobe.v1.FromProbe";
/** What a chunk unpacks to at most; those of `lightprobe record` have some 16 KiB. */
const MOST_BYTES = 16 << 20;
/** A tab takes so much and no more: hours of a probe. Without it, a file of a few KB could unpack until the tab hangs. */
const MOST_FILE_BYTES = 256 << 20, MOST_UNPACKED_BYTES = 256 << 20, MOST_RECORDS = 300_000;
const SHORTER = "record a shorter one (`lightprobe record room.mcap --seconds 60`), or play it with `lightprobe replay`";

/** Told how far it is: the share of the file that is read, and what has been unpacked so far. */
export type Told = (share: number, unpackedBytes: number) => void;

/** Nothing of such a file is played, not even what comes before the place that is at fault. */
class Refused extends Error {}

/** Error for a file that is too large, before it is read. */
export function checkSize(bytes: number): void {
  if (bytes > MOST_FILE_BYTES) throw new Refused(`has ${Math.ceil(bytes / 2 ** 20)} MiB, and this page plays files of up to ${MOST_FILE_BYTES >> 20} MiB: ${SHORTER}`);
}

class Reader {
  readonly #view: DataView;
  #at = 0;

  constructor(readonly bytes: Uint8Array) {
    this.#view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  }

  /** How much of it is read. */
  get share(): number {
    return this.#at / Math.max(1, this.bytes.length);
  }

  get left(): number {
    return this.bytes.length - this.#at;
  }

  /** RangeError past the end, as of all that follow. */
  take(count: number): Uint8Array {
    if (count > this.left) throw new RangeError("cut off");
    return this.bytes.subarray(this.#at, (this.#at += count));
  }

  #number(size: number, read: (at: number) => number): number {
    const at = this.#at;
    this.take(size);
    return read(at);
  }

  u8 = (): number => this.#number(1, (at) => this.#view.getUint8(at));
  u16 = (): number => this.#number(2, (at) => this.#view.getUint16(at, true));
  u32 = (): number => this.#number(4, (at) => this.#view.getUint32(at, true));
  /** Lengths, which are below 2⁵³. */
  u64 = (): number => this.#number(8, (at) => Number(this.#view.getBigUint64(at, true)));
  timeMs = (): number => this.#number(8, (at) => Number(this.#view.getBigUint64(at, true) / 1000n) / 1000);
  text = (): string => new TextDecoder().decode(this.take(this.u32()));
}

class Parser {
  readonly #ours = new Set<number>();
  readonly #channels = new Set<number>();
  readonly found: Recorded[] = [];
  #records = 0;
  #unpackedBytes = 0;

  constructor(readonly told: Told) {}

  /** All records of the file, or of a chunk. */
  read(reader: Reader, isChunk = false): void {
    while (reader.left > 0) {
      const kind = reader.u8(), record = new Reader(reader.take(reader.u64()));
      if (++this.#records > MOST_RECORDS) throw new Refused(`holds more than ${MOST_RECORDS} messages and other records, which this page does not play: ${SHORTER}`);
      if (kind === CHUNK && isChunk) throw new Refused("has a chunk within a chunk, which MCAP does not allow: record one with `lightprobe record`");
      if (kind === CHUNK) {
        this.read(new Reader(this.#unpacked(record)), true);
        this.told(reader.share, this.#unpackedBytes);
      }
      if (kind === SCHEMA) this.#readSchema(record);
      else if (kind === CHANNEL) this.#readChannel(record);
      else if (kind === MESSAGE) this.#readMessage(record);
      if (reader.left === MAGIC.length) return; // the file ends as it begins
    }
  }

  /** What is in a chunk; Error for what no recording of a probe has. */
  #unpacked(chunk: Reader): Uint8Array {
    chunk.take(16); // first and last time
    const size = chunk.u64();
    chunk.take(4); // checksum
    const compression = chunk.text(), data = chunk.take(chunk.u64());
    if (size > MOST_BYTES) throw new Error(`a chunk unpacks to more than ${MOST_BYTES >> 20} MiB`);
    this.#unpackedBytes += Math.max(size, data.length);
    if (this.#unpackedBytes > MOST_UNPACKED_BYTES) throw new Refused(`unpacks to more than ${MOST_UNPACKED_BYTES >> 20} MiB, which this page does not play: ${SHORTER}`);
    if (compression === "") return data;
    if (compression !== "zstd") throw new Error(`compression ${compression.slice(0, 20)}: expected zstd, as lightprobe record writes it`);
    return decompress(data, new Uint8Array(size));
  }

  #readSchema(record: Reader): void {
    const id = record.u16();
    if (record.text() === OF_A_PROBE) this.#ours.add(id);
  }

  #readChannel(record: Reader): void {
    const id = record.u16();
    if (this.#ours.has(record.u16())) this.#channels.add(id);
  }

  #readMessage(record: Reader): void {
    if (!this.#channels.has(record.u16())) return;
    record.take(4); // number
    const timeMs = record.timeMs();
    record.take(8);
    this.found.push({ timeMs, data: record.take(record.left) });
  }
}

/** The messages of a recording in the order of the file, as far as it goes; Error for a file that holds none, or more than a tab plays. */
export function readRecording(bytes: Uint8Array, told: Told = () => {}): Recorded[] {
  checkSize(bytes.length);
  const reader = new Reader(bytes), parser = new Parser(told);
  if (bytes.length < MAGIC.length || !reader.take(MAGIC.length).every((value, i) => value === MAGIC[i]))
    throw new Error("is no MCAP file: record one with `lightprobe record`");
  let why = "";
  try {
    parser.read(reader);
  } catch (error) {
    if (error instanceof Refused) throw error;
    // It may be cut off, where the recorder was killed.
    why = ` (${(error as Error).message})`;
  }
  const first = parser.found[0];
  if (!first) throw new Error(`holds no message of a probe${why}: record one with \`lightprobe record\``);
  return parser.found.map(({ timeMs, data }) => ({ timeMs: timeMs - first.timeMs, data }));
}
