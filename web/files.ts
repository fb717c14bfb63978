// SPDX-License-Identifier: Apache-2.0
/** Files that the user drops on the page or chooses: objects and recordings. */

const element = (id: string): HTMLElement => document.getElementById(id)!;

export type Kind = "object" | "recording";

/** What a file is, by its name; an Error that says what the page takes. */
export function kindOf(name: string): Kind {
  if (/\.(glb|gltf)$/i.test(name)) return "object";
  if (/\.mcap$/i.test(name)) return "recording";
  throw new Error("this page shows objects (.glb) and plays recordings (.mcap, of `lightprobe record`)");
}

const hasFiles = (event: DragEvent): boolean => event.dataTransfer?.types.includes("Files") ?? false;

/** Calls `open` with every file that is chosen, or dropped anywhere on the page. */
export function wireFiles(open: (file: File) => void): void {
  const input = element("object") as HTMLInputElement;
  input.addEventListener("change", () => {
    const file = input.files?.[0];
    if (file) open(file);
    input.value = ""; // the same file may be chosen again
  });
  let depth = 0; // enter and leave come for every element on the way
  const show = (by: number): void => {
    depth = by === 0 ? 0 : Math.max(0, depth + by);
    element("drop").hidden = depth === 0;
  };
  addEventListener("dragenter", (event) => { if (hasFiles(event)) show(1); });
  addEventListener("dragleave", (event) => { if (hasFiles(event)) show(-1); });
  addEventListener("dragover", (event) => { if (hasFiles(event)) event.preventDefault(); });
  addEventListener("drop", (event) => {
    if (!hasFiles(event)) return;
    event.preventDefault(); // else the browser leaves the page for the file
    show(0);
    const file = event.dataTransfer!.files[0];
    if (file) open(file);
  });
}
