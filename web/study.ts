// SPDX-License-Identifier: Apache-2.0
/** The page of `lightprobe study make`: trials, and the answers as a file. It sends nothing. */
import { turns, type Trial, type Turn } from "./study_order.js";

interface Texts { title: string; contact: string; consent: string; rating_question: string; rating_ends: string[]; choice_question: string }
interface Data { version: number; study: string; texts: Texts; size: [number, number]; pictures: Record<string, string>; minutes: number; trials: Trial[] }
interface Answer { trial: string; value: number; swapped: boolean; ms: number }
interface Screen { width: number; height: number; ratio: number; layout: "beside" | "stacked"; shown_px: number }
/** What is kept on this device, and becomes the answers file. */
interface Session { participant: string; seed: number; began: string; ended: string | null; reloads: number; screen: Screen; answers: Answer[] }

const HIGHEST = 10;
/** Between two trials the place of the pictures is empty: what changes from one to the next is not seen. */
const EMPTY_MS = 250;
/** Pictures of few pixels are enlarged up to this width. */
const WIDE_PX = 720;
const LEAST_PX = 96;
/** Heights beside the pictures, in CSS pixels: question, scale, buttons, progress. */
const BESIDE_RATING_PX = 350, BESIDE_CHOICE_PX = 235, GAP_PX = 12, FRAME_PX = 8, EDGE_PX = 16;

const element = <T extends HTMLElement>(id: string): T => document.getElementById(id) as T;
const data = JSON.parse(element("data").textContent!) as Data;
const KEY = `lightprobe-study-${data.study}`;
const pictures = new Map<string, HTMLImageElement>();
let session: Session | undefined, order: Turn[] = [], shownAt_ms = 0, saved = true;

// ------------------------------------------------------------------ what is kept

function save(): void {
  try {
    localStorage.setItem(KEY, JSON.stringify(session));
    saved = true;
  } catch {
    saved = false; // a private window, or a browser that keeps nothing of files: the page asks before it is left
  }
}

function forget(): void {
  try { localStorage.removeItem(KEY); } catch { /* nothing is kept */ }
}

/** The session that a reload has interrupted; undefined where there is none that fits this page. */
function kept(): Session | undefined {
  try {
    const found = JSON.parse(localStorage.getItem(KEY) ?? "null") as Session | null;
    if (!found) return undefined;
    const expected = turns(data.trials, found.seed);
    const fits = found.answers.every((one, k) => one.trial === expected[k]?.trial.id);
    return fits && found.screen.shown_px >= LEAST_PX ? found : undefined;
  } catch {
    return undefined;
  }
}

function fresh(): Session {
  const asked = new URLSearchParams(location.hash.slice(1));
  const [seed, high, low] = crypto.getRandomValues(new Uint32Array(3)) as unknown as [number, number, number];
  const wanted = Number(asked.get("seed") ?? NaN);
  const hex = (value: number): string => value.toString(16).padStart(8, "0");
  return {
    participant: asked.get("participant")?.slice(0, 100) || hex(high) + hex(low),
    seed: Number.isInteger(wanted) && wanted >= 0 && wanted < 2 ** 32 ? wanted : seed,
    began: new Date().toISOString(), ended: null, reloads: 0, screen: measured(), answers: [],
  };
}

/** How large the pictures are for all of the session: two of them fit on the screen, beside or above each other. */
function measured(): Screen {
  const width = document.documentElement.clientWidth, height = innerHeight, aspect = data.size[0] / data.size[1];
  const single = Math.min(width - EDGE_PX - FRAME_PX, (height - BESIDE_RATING_PX) * aspect);
  const beside = Math.min((width - EDGE_PX - GAP_PX) / 2 - FRAME_PX, (height - BESIDE_CHOICE_PX - FRAME_PX) * aspect);
  const stacked = Math.min(width - EDGE_PX - FRAME_PX, ((height - BESIDE_CHOICE_PX - GAP_PX) / 2 - FRAME_PX) * aspect);
  const widest = Math.max(data.size[0], WIDE_PX);
  const fits = Math.min(Math.max(beside, stacked), single, widest);
  return {
    width, height, ratio: devicePixelRatio, layout: beside >= stacked ? "beside" : "stacked",
    shown_px: Math.max(Math.floor(fits), LEAST_PX),
  };
}

// ------------------------------------------------------------------ pages

function show(page: "welcome" | "trial" | "end" | "stopped"): void {
  for (const one of ["welcome", "trial", "end", "stopped"]) element(one).hidden = one !== page;
  scrollTo(0, 0);
}

/** Load every picture before the first trial, so that no time is lost to the network. */
async function load(): Promise<void> {
  const places = Object.entries(data.pictures);
  let done = 0;
  await Promise.all(places.map(async ([id, place]) => {
    const picture = new Image();
    picture.src = place;
    picture.alt = "";
    picture.draggable = false;
    try {
      await picture.decode();
    } catch {
      const name = place.startsWith("data:") ? id : place;
      throw new Error(`The picture ${name} cannot be loaded. Keep the folder of pictures beside this page, then reload it.`);
    }
    pictures.set(id, picture);
    element("loading").textContent = `Pictures: ${++done} of ${places.length}`;
  }));
  element("loading").textContent = "";
}

async function welcome(): Promise<void> {
  const { title, contact, consent } = data.texts;
  element("title").textContent = title;
  const kinds = new Set(data.trials.map((one) => one.kind));
  const tasks = [
    ...(kinds.has("rating") ? [`you rate how real the object in a picture looks, from 0 (${data.texts.rating_ends[0]}) to ${HIGHEST} (${data.texts.rating_ends[1]})`] : []),
    ...(kinds.has("choice") ? ["you choose between two pictures"] : []),
  ];
  element("about").textContent = `In ${data.trials.length} short tasks ${tasks.join("; then ")}. It takes about ${data.minutes === 1 ? "a minute" : `${data.minutes} minutes`}. `
    + "Some objects are real, and some are drawn by a computer. A few tasks only check that you look. You cannot go back to a task.";
  element("consent").textContent = consent;
  element("contact").textContent = contact && `Questions: ${contact}`;
  show("welcome");
  const before = kept();
  await load();
  if (before) {
    session = { ...before, reloads: before.reloads + 1 };
    resume();
    return;
  }
  const begin = element<HTMLButtonElement>("begin");
  begin.disabled = false;
  begin.focus();
}

function resume(): void {
  order = turns(data.trials, session!.seed);
  save();
  next();
}

/** Show the next trial, or the end. */
function next(): void {
  const turn = order[session!.answers.length];
  if (!turn) {
    end();
    return;
  }
  const { trial } = turn, done = session!.answers.length, rates = trial.kind === "rating";
  show("trial");
  element("question").textContent = rates ? data.texts.rating_question : data.texts.choice_question;
  element("asked").textContent = `This one checks that you look: please give it a ${trial.asked ?? ""}.`;
  element("asked").hidden = trial.asked === undefined;
  element("scale").hidden = element("ends").hidden = !rates;
  element("which").textContent = rates ? "" : `Touch a picture, or press ${session!.screen.layout === "beside" ? "← or →" : "↑ or ↓"}, then Next.`;
  element("which").hidden = rates;
  const progress = element<HTMLProgressElement>("progress");
  [progress.max, progress.value] = [order.length, done];
  element("count").textContent = `${done + 1} of ${order.length}`;
  element<HTMLButtonElement>("next").disabled = true;
  for (const one of element("scale").querySelectorAll("input")) one.checked = false;
  (document.activeElement as HTMLElement | null)?.blur(); // no frame around what was said of the picture before
  place(turn);
  appear();
}

function place({ trial, swapped }: Turn): void {
  const { shown_px, layout } = session!.screen, box = element("pictures");
  box.className = layout;
  box.style.visibility = "hidden";
  const ids = swapped ? [...trial.pictures].reverse() : trial.pictures;
  box.replaceChildren(...ids.map((id, k) => {
    const picture = pictures.get(id)!.cloneNode() as HTMLImageElement;
    picture.width = shown_px;
    picture.height = Math.round(shown_px * data.size[1] / data.size[0]);
    picture.alt = "the picture";
    if (trial.kind === "rating") return picture;
    const label = document.createElement("label"), words = layout === "beside" ? ["left", "right"] : ["upper", "lower"];
    picture.alt = `${words[k]!} picture`;
    label.append(picture, Object.assign(document.createElement("input"), { type: "radio", name: "choice", value: String(swapped ? 1 - k : k) }));
    return label;
  }));
}

/** After a moment in which nothing is there. */
function appear(): void {
  shownAt_ms = 0;
  const answered = session!.answers.length;
  setTimeout(() => requestAnimationFrame(() => {
    if (session?.answers.length !== answered) return;
    element("pictures").style.visibility = "visible";
    shownAt_ms = performance.now();
  }), EMPTY_MS);
}

const chosen = (): HTMLInputElement | null => document.querySelector<HTMLInputElement>("#trial input:checked");

function answer(): void {
  const found = chosen(), turn = order[session!.answers.length];
  if (!found || !turn || !shownAt_ms) return;
  session!.answers.push({ trial: turn.trial.id, value: Number(found.value), swapped: turn.swapped, ms: Math.round(performance.now() - shownAt_ms) });
  if (session!.answers.length === order.length) session!.ended = new Date().toISOString();
  save();
  if (session!.ended) download();
  next();
}

// ------------------------------------------------------------------ the end

const fileName = (): string => `answers-${session!.participant.replace(/[^\w-]/g, "_")}.json`;

function download(): void {
  const head = { kind: "lightprobe study answers", version: data.version, study: data.study, simulated: false };
  const text = JSON.stringify({ ...head, ...session }, null, 1);
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: "application/json" }));
  link.download = fileName();
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 60_000);
}

function end(): void {
  element("file").textContent = fileName();
  show("end");
}

function stop(): void {
  if (!confirm("Stop, and delete all of your answers?")) return;
  forget();
  session = undefined;
  show("stopped");
}

// ------------------------------------------------------------------ hands

/** Digits rate (1, then 0: ten), arrows choose, Enter goes on. */
function key(event: KeyboardEvent): void {
  const turn = session && !session.ended && order[session.answers.length];
  if (!turn || event.ctrlKey || event.altKey || event.metaKey || (event.target as HTMLElement).id === "stop") return;
  if (event.key === "Enter") {
    event.preventDefault();
    if (!event.repeat) answer(); // a key that is held down answers nothing
    return;
  }
  const index = pressed(event.key, turn.trial.kind);
  if (index === undefined || !shownAt_ms) return;
  event.preventDefault();
  const input = document.querySelectorAll<HTMLInputElement>(turn.trial.kind === "rating" ? "#scale input" : "#pictures input")[index];
  input?.focus();
  input?.click();
}

function pressed(name: string, kind: Trial["kind"]): number | undefined {
  if (kind === "choice") {
    if (name === "ArrowLeft" || name === "ArrowUp") return 0;
    return name === "ArrowRight" || name === "ArrowDown" ? 1 : undefined;
  }
  if (!/^\d$/.test(name)) return undefined;
  return name === "0" && chosen()?.value === "1" ? HIGHEST : Number(name);
}

function wire(): void {
  element("scale").append(...Array.from({ length: HIGHEST + 1 }, (_, value) => {
    const label = Object.assign(document.createElement("label"), { textContent: String(value) });
    label.append(Object.assign(document.createElement("input"), { type: "radio", name: "rating", value: String(value) }));
    return label;
  }));
  [...element("ends").children].forEach((one, k) => { one.textContent = data.texts.rating_ends[k]!; });
  element("trial").addEventListener("change", () => { element<HTMLButtonElement>("next").disabled = !chosen(); });
  element("answer").addEventListener("submit", (event) => { event.preventDefault(); answer(); });
  document.addEventListener("keydown", key);
  element("begin").addEventListener("click", () => { session = fresh(); resume(); });
  element("stop").addEventListener("click", stop);
  element("download").addEventListener("click", download);
  element("another").addEventListener("click", () => {
    if (!confirm(`Is ${fileName()} kept? It is deleted from this page.`)) return;
    forget();
    // #participant=… and #seed=… were for who has answered: the next one gets a name and a seed of their own.
    history.replaceState(null, "", location.href.replace(/#.*/, ""));
    location.reload();
  });
  addEventListener("beforeunload", (event) => { if (session && !session.ended && !saved) event.preventDefault(); });
}

wire();
welcome().catch((error: unknown) => {
  element("problem").textContent = (error as Error).message;
  element("problem").hidden = false;
});
