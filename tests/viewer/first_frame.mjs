// Prints the seconds from its own start until the page at URL answers, and until it has drawn a hand: node
// first_frame.mjs URL SECONDS. The browser starts when the page answers, so that it does not slow a build down before.
import { browser, pause, until } from "./harness.mjs";

const [url, patience] = [process.argv[2], Number(process.argv[3])];
const start = Date.now();
const seconds = () => ((Date.now() - start) / 1000).toFixed(1);
await until(
  `an answer of ${url}`,
  async () => {
    const answer = await fetch(url).catch(() => undefined);
    if (!answer?.ok) await pause(200);
    return answer?.ok;
  },
  patience,
);
console.log(`page answers: ${seconds()} s`);
const chromium = await browser();
const page = await chromium.newPage();
await page.goto(url);
await until("nodes of a hand", () => page.evaluate(() => window.softhand.counts.nodes > 0), 120);
const drawn = await page.evaluate(() => window.softhand.counts.drawn);
await until("a picture", () => page.evaluate((n) => window.softhand.counts.drawn > n, drawn), 120);
console.log(`first frame with a hand: ${seconds()} s`);
await chromium.close();
