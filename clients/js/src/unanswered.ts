// SPDX-License-Identifier: Apache-2.0
/** Why a probe may not have answered, in a sentence. Browsers hide from pages why a connection was refused. */

/** `url`: ws: or wss:, with / at its end; `origin`: of this page, undefined outside of browsers. */
export function whyUnanswered(url: string, origin: string | undefined): string {
  const questions = ["is lightprobed running"];
  const page = url.replace(/^ws/, "http");
  if (url.startsWith("wss:")) questions.push(`does the browser accept the probe's certificate (open ${page} to see)`);
  if (origin !== undefined && `${origin}/` !== page) questions.push(mayRead(url, origin));
  return `${url}: connect: no answer: ${questions.join(", and ")}?`;
}

/** A daemon refuses pages that are not its own (403), unless its owner names their origin. */
function mayRead(url: string, origin: string): string {
  if (origin === "null") return "may this page read it: a daemon refuses pages of files: serve this one by http:";
  return `may pages of ${origin} read it: start lightprobed with ?origins=${origin} at the end of its --publish=${url.split(":")[0]}:…`;
}
