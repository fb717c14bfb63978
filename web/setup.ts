// SPDX-License-Identifier: Apache-2.0
/** The page of `lightprobe setup`: settings, and tasks that are commands of `lightprobe`. */

interface Choice { value: string; words: string }
interface Field { name: string; label: string; kind: string; initial: string; choices: string[] }
interface Task {
  name: string; title: string; words: string; fields: Field[]; takes_devices: boolean; asks: boolean; ends_by_itself: boolean; restarts: boolean; minutes: number; setting: string; next_step: string;
}
interface State {
  name: string; version: string; card: string | null; boot: string; config: string; text: string; runs: boolean; log: string[]; probe: string | null; settings: Record<string, string[]>;
  sources: Choice[]; ports: Choice[]; cameras: Choice[]; tasks: Task[];
}
interface Told { task: string; status: number | null; waits: boolean; said: number; lines: string[]; seconds: number; files: string[]; written: string | null }

interface Network { name: string; ssid: string; security: string; signal_percent: number | null; joined: boolean; known: boolean }
interface Link { kind: string; name: string; device: string; is_up: boolean }
interface Networks {
  page: string; works: boolean; why: string; last: { what: string; name: string; problem: string } | null;
  view: { links: Link[]; networks: Network[]; own_access_point: string } | null;
}

const element = <T extends HTMLElement>(id: string): T => document.getElementById(id) as T;
const owner = new URLSearchParams(location.hash.slice(1)).get("owner") ?? "";
const MOST_LINES = 2000;
const RESTARTED = "the probe has restarted: its version is above";
let state: State | undefined;

/** The probe has answered, and not with what was asked for. */
class Refused extends Error {
  constructor(words: string, readonly status: number) { super(words); }
}

/** Ask the probe; rejects with its words (Refused), or because it does not answer. */
async function ask<T>(method: string, path: string, body?: unknown): Promise<T> {
  let answer: Response;
  try {
    answer = await fetch(`/api/${path}`, { method, headers: { Authorization: `Bearer ${owner}` }, ...(body === undefined ? {} : { body: JSON.stringify(body) }) });
  } catch {
    throw new Error("The probe does not answer. Is `lightprobe setup` still running, and is this device in its network?");
  }
  const said = (await answer.json().catch(() => ({}))) as { problem?: string };
  if (!answer.ok) throw new Refused(said.problem ?? `The probe answers ${answer.status}.`, answer.status);
  return said as T;
}

/** Send a file, for the task that is begun next; rejects with the probe's words. */
function send(file: File): Promise<void> {
  return new Promise((done, fail) => {
    const request = new XMLHttpRequest();
    request.open("PUT", "/api/upload");
    request.setRequestHeader("Authorization", `Bearer ${owner}`);
    request.upload.onprogress = ({ loaded, total }) => { element("status").textContent = `is sent ${file.name}: ${Math.floor((100 * loaded) / total)} %`; };
    request.onerror = () => fail(new Error(`${file.name} did not arrive: is the probe still in this network? Send it again.`));
    request.onload = () => {
      if (request.status === 200) return done();
      let words = `The probe answers ${request.status}.`;
      try {
        words = (JSON.parse(request.responseText) as { problem?: string }).problem ?? words;
      } catch {
        // not the probe's own answer
      }
      fail(new Error(words));
    };
    request.send(file);
  });
}

function show(problem: string): void {
  const place = element("problem");
  place.textContent = problem;
  place.hidden = !problem;
  if (problem) place.scrollIntoView({ block: "nearest" });
}

/** Do something for the user; what goes wrong is shown. */
async function act(work: () => Promise<void>): Promise<void> {
  show("");
  try {
    await work();
  } catch (error) {
    show((error as Error).message);
  }
}

/** While the probe restarts or a task runs, nothing else can be begun. */
function busy(is: boolean): void {
  for (const button of document.querySelectorAll<HTMLButtonElement>("#settings button, #tasks button, #save-text, #use")) button.disabled = is;
}

// ------------------------------------------------------------------ settings

const form = element<HTMLFormElement>("settings");
const controls = (): (HTMLInputElement | HTMLSelectElement | HTMLTextAreaElement)[] =>
  [...form.querySelectorAll<HTMLInputElement | HTMLSelectElement | HTMLTextAreaElement>("input, select, textarea")];
const IN_LISTS = new Set(["publish"]);

function fill(list: string, choices: Choice[]): void {
  element(list).replaceChildren(...choices.map(({ value, words }) => Object.assign(document.createElement("option"), { value, textContent: words })));
}

/** Ask how it stands. `refill`: the settings are shown as they are, too, in the place of what the user has typed. */
async function look(refill = true): Promise<void> {
  state = await ask<State>("GET", "state");
  element("name").textContent = state.name;
  element("status").textContent = `${state.runs ? "runs" : "does not run: see its log below"}, version ${state.version}${state.card ? `, card ${state.card}` : ""}`;
  element("status").classList.toggle("bad", !state.runs);
  fill("sources", state.sources);
  fill("cameras", [{ value: "equirect", words: "a whole sphere, already flattened" }, ...state.cameras]);
  fill("boards", state.ports.map(({ value, words }) => ({ value: `mcu:${value}`, words })));
  element("log").textContent = state.log.join("\n");
  if (!refill) return;
  for (const control of controls()) {
    const values = state.settings[control.name] ?? [];
    control.value = values.join("\n") || (control.name === "preset" ? "balanced" : "");
    const several = values.length > 1 && !IN_LISTS.has(control.name);
    control.disabled = several;
  }
  element("several").hidden = (state.settings["source"]?.length ?? 0) < 2;
  element("config").textContent = state.config;
  element<HTMLTextAreaElement>("text").value = state.text;
}

async function change(body: unknown): Promise<void> {
  busy(true);
  element("status").textContent = "is restarted";
  let done = false;
  try {
    await ask("PUT", "settings", body);
    done = true;
  } finally {
    busy(false);
    await look(done);
  }
}

form.addEventListener("submit", (event) => {
  event.preventDefault();
  const set: Record<string, string[]> = {};
  for (const control of controls()) {
    const values = control.value.split("\n").map((value) => value.trim()).filter(Boolean);
    const before = state?.settings[control.name] ?? [];
    if (!control.disabled && values.join("\n") !== before.join("\n") && !(control.name === "preset" && !before.length && control.value === "balanced")) set[control.name] = values;
  }
  void act(() => change({ set }));
});
element("restart").addEventListener("click", () => void act(async () => {
  busy(true);
  try {
    await ask("POST", "restart");
  } finally {
    busy(false);
    await look(false);
  }
}));
element("save-text").addEventListener("click", () => void act(() => change({ text: element<HTMLTextAreaElement>("text").value })));

// ------------------------------------------------------------------ tasks

/** What a field begins with: what the probe uses now. */
function initial(field: Field): string {
  const board = (state?.settings["rotator"] ?? state?.settings["ring"] ?? [])[0];
  switch (field.kind) {
    case "source": return state?.settings["source"]?.[0] ?? state?.sources[0]?.value ?? "v4l2:";
    case "port": return board?.startsWith("mcu:") ? board.slice(4).split("?")[0]! : state?.ports[0]?.value ?? "serial:/dev/lightprobe-mcu";
    case "probe": return state?.probe ?? "tcp:127.0.0.1:7700";
    default: return field.initial;
  }
}

function control(field: Field): HTMLInputElement | HTMLSelectElement {
  if (field.kind === "choice") {
    const select = document.createElement("select");
    select.append(...field.choices.map((value) => new Option(value, value, value === field.initial)));
    return select;
  }
  const input = document.createElement("input");
  input.autocomplete = "off";
  if (field.kind === "upload") Object.assign(input, { type: "file", accept: ".raucb", required: true });
  if (field.kind === "number") Object.assign(input, { type: "number", step: "any", required: true });
  if (field.kind === "source") input.setAttribute("list", "sources");
  return input;
}

function card(task: Task): HTMLFormElement {
  const place = document.createElement("form");
  place.className = "task";
  place.dataset["task"] = task.name;
  const fold = document.createElement("details");
  const title = Object.assign(document.createElement("summary"), { textContent: task.title });
  const took = task.minutes < 0.5 ? "" : ` Takes about ${task.minutes < 1.5 ? "a minute" : `${Math.round(task.minutes)} minutes`}.`;
  const words = Object.assign(document.createElement("p"), { className: "dim", textContent: `${task.words}${took}${task.takes_devices ? " The probe sends no light meanwhile." : ""}` });
  const inputs = task.fields.map((field) => ({ field, input: control(field) }));
  const labels = inputs.map(({ field, input }) => {
    const label = document.createElement("label");
    // As the settings are when it is opened, until the user has written something.
    const begin = (): void => { if (!["choice", "upload"].includes(field.kind) && !input.dataset["written"]) input.value = initial(field); };
    begin();
    fold.addEventListener("toggle", begin);
    input.addEventListener("input", () => { input.dataset["written"] = "yes"; });
    label.append(`${field.label} `, input);
    return label;
  });
  const begin = Object.assign(document.createElement("button"), { textContent: "Begin" });
  fold.append(title, words, ...labels, begin);
  place.append(fold);
  place.addEventListener("submit", (event) => {
    event.preventDefault();
    const fields = Object.fromEntries(inputs.map(({ field, input }) => [field.name, input.value]));
    void act(async () => {
      for (const file of inputs.flatMap(({ input }) => [...((input as HTMLInputElement).files ?? [])])) {
        busy(true);
        try {
          await send(file);
        } finally {
          busy(false);
          await look(false);
        }
      }
      await ask("POST", "job", { task: task.name, fields });
      await follow();
    });
  });
  return place;
}

async function picture(name: string): Promise<HTMLElement> {
  const answer = await fetch(`/api/job/files/${name}`, { headers: { Authorization: `Bearer ${owner}` } });
  if (!answer.ok) throw new Error(`${name}: the probe answers ${answer.status}.`);
  const url = URL.createObjectURL(await answer.blob());
  return name.endsWith(".png")
    ? Object.assign(document.createElement("img"), { src: url, alt: name })
    : Object.assign(document.createElement("a"), { href: url, download: name, textContent: `Save ${name}` });
}

/** A phone sleeps, a network goes away, the probe restarts: ask again, until there is an answer. */
async function patiently<T>(work: () => Promise<T>): Promise<T> {
  for (let left = 60; ; left--) {
    try {
      const found = await work();
      if (left < 60) show("");
      return found;
    } catch (error) {
      show("");
      if (!left || error instanceof Refused) throw error;
      show((error as Error).message);
      await new Promise((done) => setTimeout(done, 2000));
    }
  }
}

/** Wait for the next start of the probe, three minutes at most. */
async function restarted(): Promise<void> {
  const before = state!.boot;
  element("running-state").textContent = "done: the probe restarts";
  for (let left = 90; left && state!.boot === before; left--) {
    await new Promise((done) => setTimeout(done, 2000));
    await look(false).catch(() => undefined); // it does not answer yet
  }
  element("running-state").textContent = state!.boot === before ? "done, but the probe has not restarted in three minutes: switch it off and on" : RESTARTED;
}

/** Show a task until it ends. */
async function follow(): Promise<void> {
  const output = element("output"), lines: string[] = [];
  let said = 0;
  busy(true);
  element("files").replaceChildren();
  output.textContent = "";
  element("running-state").textContent = "runs";
  element("running").hidden = false;
  element("running").scrollIntoView({ block: "start" });
  try {
    for (;;) {
      const told = await patiently(() => ask<Told>("GET", `job?after=${said}`)).catch((error: Error) => {
        if (error instanceof Refused && error.status === 404) return undefined;
        throw error;
      });
      if (!told) {
        element("running-state").textContent = RESTARTED;
        element("while-running").hidden = true;
        break;
      }
      const task = state!.tasks.find(({ name }) => name === told.task)!;
      said = told.said;
      lines.push(...told.lines);
      lines.splice(0, lines.length - MOST_LINES);
      output.textContent = lines.join("\n");
      output.scrollTop = output.scrollHeight;
      element("running-title").textContent = task.title;
      element("while-running").hidden = told.status !== null;
      element("stop").hidden = task.ends_by_itself;
      for (const id of ["continue", "skip"]) {
        element(id).hidden = !task.asks;
        element<HTMLButtonElement>(id).disabled = !told.waits;
      }
      const seconds = Math.round(told.seconds);
      element("running-state").textContent = told.status === null ? `runs, ${seconds} s` : `${told.status === 0 ? "done" : `ended with status ${told.status}: read what it says`}, after ${seconds} s`;
      element("next").textContent = told.status === 0 ? task.next_step : "";
      const use = element<HTMLButtonElement>("use");
      use.hidden = !(told.written && task.setting) || (state!.settings["source"]?.length ?? 0) > 1;
      use.textContent = `Use ${told.written?.split("/").pop()}`;
      use.onclick = () => void act(() => change({ set: { [task.setting]: [told.written!] } }));
      if (told.status === null) continue;
      element("files").replaceChildren(...(await Promise.all(told.files.map(picture))));
      if (task.restarts && told.status === 0) await restarted();
      break;
    }
  } finally {
    busy(false);
    await patiently(() => look(false)); // it may have restarted
  }
}

// ------------------------------------------------------------------ network

const joining = element<HTMLFormElement>("join");
const field = (name: string): HTMLInputElement => joining.elements.namedItem(name) as HTMLInputElement;
const NEEDS_NO_PASSWORD = new Set(["open", "OWE"]);
let chosen: Network | undefined; // whose name is in the form

function linkWords(links: Link[]): string {
  if (!links.length) return "Connected by nothing.";
  const words = links.map(({ kind, name, device, is_up }) => `${kind === "access point" ? "its own Wi-Fi" : kind} ${name} (${device})${is_up ? "" : ", on its way"}`);
  return `Connected by ${words.join("; ")}.`;
}

/** Said before: joining may cut this page off. */
function noteWords(own: string): string {
  return own
    ? `The probe has opened a Wi-Fi of its own, ${own}. Joining another closes it, and a page that was opened in it is cut off. If joining fails, the probe's own Wi-Fi comes back within two minutes, and this page says why. Else let this device join the same network; the page is then at `
    : "After joining another network, this page is for devices in that network, at ";
}

function showNote({ page, view }: Networks): void {
  const link = Object.assign(document.createElement("a"), { href: page + location.hash, textContent: page });
  element("network-note").replaceChildren(...(view ? [noteWords(view.own_access_point), link] : []));
}

function endWords({ works, last }: Networks): string {
  if (!last) return "";
  if (works) return `${last.what === "join" ? "Joining" : "Forgetting"} ${last.name}: up to two minutes.`;
  return last.problem || `${last.name} is ${last.what === "join" ? "joined" : "forgotten"}.`;
}

function networkButton(text: string, work: () => Promise<void>): HTMLButtonElement {
  const made = Object.assign(document.createElement("button"), { type: "button", textContent: text });
  made.addEventListener("click", () => void act(work));
  return made;
}

function networkRow(network: Network): HTMLLIElement {
  const row = document.createElement("li");
  const about = [network.signal_percent === null ? "not in reach" : `${network.signal_percent} %`, network.security, network.joined ? "joined" : network.known ? "known" : ""];
  row.append(
    Object.assign(document.createElement("b"), { textContent: network.name }),
    Object.assign(document.createElement("span"), { className: "dim", textContent: about.filter(Boolean).join(", ") }),
  );
  if (!network.joined && network.signal_percent !== null) row.append(networkButton("Join", () => choose(network)));
  if (network.known) row.append(networkButton("Forget", () => forget(network)));
  return row;
}

async function forget(network: Network): Promise<void> {
  const words = `The probe leaves ${network.name}, and this page is cut off if it was opened there. Then look for the probe's own Wi-Fi. Leave it?`;
  if (!network.joined || confirm(words)) await alter("forget", { ssid: network.ssid });
}

/** Join it, or ask for its password. */
async function choose(network: Network): Promise<void> {
  if (network.known || NEEDS_NO_PASSWORD.has(network.security)) return alter("join", { ssid: network.ssid });
  field("network").value = network.name;
  chosen = network;
  field("password").focus();
}

async function alter(what: "join" | "forget", body: unknown): Promise<void> {
  await ask("POST", `network/${what}`, body);
  await followNetwork();
}

function showNetworks(told: Networks): void {
  element("links").textContent = told.view ? linkWords(told.view.links) : told.why;
  showNote(told);
  element("networks").replaceChildren(...(told.view?.networks ?? []).map(networkRow));
  element("network-state").textContent = endWords(told);
  joining.hidden = !told.view;
  for (const button of document.querySelectorAll<HTMLButtonElement>("#network button")) button.disabled = told.works;
}

/** Show how it stands, until nothing changes any more. */
async function followNetwork(): Promise<void> {
  for (;;) {
    const told = await patiently(() => ask<Networks>("GET", "network"));
    showNetworks(told);
    if (!told.works) return;
    await new Promise((done) => setTimeout(done, 1000));
  }
}

field("network").addEventListener("input", () => { chosen = undefined; });
joining.addEventListener("submit", (event) => {
  event.preventDefault();
  const password = field("password").value;
  field("password").value = "";
  void act(() => alter("join", { ...(chosen ? { ssid: chosen.ssid } : { name: field("network").value }), password }));
});
element("look-again").addEventListener("click", () => void act(followNetwork));

element("continue").addEventListener("click", () => void act(() => ask("POST", "job/answer", { skip: false })));
element("skip").addEventListener("click", () => void act(() => ask("POST", "job/answer", { skip: true })));
element("stop").addEventListener("click", () => void act(() => ask("POST", "job/stop")));

void act(async () => {
  if (!owner) throw new Error("This page needs the owner's token: open the address that `lightprobe setup` prints.");
  await look();
  element("tasks").replaceChildren(...state!.tasks.map(card));
  void act(followNetwork);
  const told = await ask<Told>("GET", "job?after=0").catch(() => undefined);
  if (told) await follow(); // begun before this page was opened, or opened anew
});
