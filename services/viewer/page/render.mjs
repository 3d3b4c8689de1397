// node render.mjs RECORDING OUT WIDTH HEIGHT SECONDS RATE VIEW: draws pictures of a page's recording for `softhand
// render`. The first 0.2 s of the recording only fill the page. SECONDS = 0 gives one PNG. Otherwise it is an animated
// PNG whose pictures contain only the changes.
import { createServer } from "node:http";
import { existsSync, readFileSync, writeFileSync } from "node:fs";
import { dirname, extname, join } from "node:path";
import { fileURLToPath } from "node:url";
import { deflateSync } from "node:zlib";
import { chromium } from "playwright-core";

const BEFORE = 0.2;
const [recording, out, width, height, seconds, rate, view = ""] = process.argv.slice(2);
const [w, h] = [Number(width), Number(height)];
const fail = (why) => {
  console.error(`softhand render: ${why}`);
  process.exit(1);
};

// ---- PNG ----

const crcTable = Uint32Array.from({ length: 256 }, (_, n) => {
  for (let k = 0; k < 8; ++k) n = n & 1 ? 0xedb88320 ^ (n >>> 1) : n >>> 1;
  return n >>> 0;
});
function chunk(type, data) {
  const body = Buffer.concat([Buffer.from(type, "latin1"), data]);
  let crc = 0xffffffff;
  for (const byte of body) crc = crcTable[(crc ^ byte) & 255] ^ (crc >>> 8);
  const all = Buffer.alloc(8 + body.length);
  all.writeUInt32BE(data.length, 0);
  body.copy(all, 4);
  all.writeUInt32BE(~crc >>> 0, 4 + body.length);
  return all;
}
const words = (...values) => {
  const buffer = Buffer.alloc(4 * values.length);
  values.forEach((value, i) => buffer.writeUInt32BE(value, 4 * i));
  return buffer;
};
/** Rows of RGBA, each with PNG's filter "Sub" or none, whichever probably compresses better. */
function compress(pixels) {
  const rows = Buffer.alloc((4 * w + 1) * h);
  for (let y = 0; y < h; ++y) {
    const row = pixels.subarray(4 * w * y, 4 * w * (y + 1));
    const sub = Buffer.from(row);
    for (let x = 4; x < sub.length; ++x) sub[x] = row[x] - row[x - 4];
    const size = (bytes) => bytes.reduce((sum, byte) => sum + Math.min(byte, 256 - byte), 0);
    const best = size(sub) < size(row) ? 1 : 0;
    rows[(4 * w + 1) * y] = best;
    (best ? sub : row).copy(rows, (4 * w + 1) * y + 1);
  }
  return deflateSync(rows, { level: 9 });
}
function animation(pictures) {
  const parts = [
    Buffer.from("\x89PNG\r\n\x1a\n", "latin1"),
    chunk("IHDR", Buffer.concat([words(w, h), Buffer.from([8, 6, 0, 0, 0])])),
    chunk("acTL", words(pictures.length, 0)),
  ];
  let sequence = 0;
  pictures.forEach((picture, i) => {
    // Dispose 0 keeps the picture, and blend 1 draws over it. Unchanged pixels are sent as transparent.
    const control = Buffer.concat([words(sequence++, w, h, 0, 0), Buffer.alloc(4), Buffer.from([0, i === 0 ? 0 : 1])]);
    // The delay of a picture is a fraction of two integers, so the rate need not be an integer.
    control.writeUInt16BE(1000, 20);
    control.writeUInt16BE(Math.round(1000 * rate), 22);
    parts.push(chunk("fcTL", control));
    let pixels = picture;
    if (i > 0) {
      pixels = Buffer.from(picture);
      for (let p = 0; p < pixels.length; p += 4)
        if (picture.readUInt32LE(p) === pictures[i - 1].readUInt32LE(p)) pixels.writeUInt32LE(0, p);
    }
    parts.push(
      i === 0
        ? chunk("IDAT", compress(pixels))
        : chunk("fdAT", Buffer.concat([words(sequence++), compress(pixels)])),
    );
  });
  return Buffer.concat([...parts, chunk("IEND", Buffer.alloc(0))]);
}

// ---- the page ----

const folder = join(dirname(fileURLToPath(import.meta.url)), "../viewer");
const types = { ".html": "text/html", ".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml" };
const server = createServer((request, response) => {
  const name = new URL(request.url, "http://x").pathname;
  const file = join(folder, name === "/" ? "index.html" : name);
  if (!existsSync(file)) return response.writeHead(404).end();
  response
    .writeHead(200, { "content-type": types[extname(file)] ?? "application/octet-stream" })
    .end(readFileSync(file));
});
await new Promise((listening) => server.listen(0, "127.0.0.1", listening));

const executablePath =
  ["/usr/bin/chromium", "/usr/bin/google-chrome"].find(existsSync) ?? fail("no chromium: apt-get install chromium");
const browser = await chromium.launch({
  executablePath,
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"],
});
try {
  const page = await browser.newPage({ viewport: { width: w, height: h } });
  page.setDefaultTimeout(180000);
  await page.goto(`http://127.0.0.1:${server.address().port}/?${view}&plain&theme=light&quality=high`);
  await page.setInputFiles("#open", recording);
  await page.waitForFunction(() => window.softhand.handCount() > 0);
  const drawn = async (pictures) => {
    const end = (await page.evaluate(() => window.softhand.counts.drawn)) + pictures;
    await page.waitForFunction((n) => window.softhand.counts.drawn >= n, end);
  };
  const at = async (time, pictures) => {
    await page.evaluate((t) => window.softhand.seek(t), BEFORE + time);
    await drawn(pictures);
  };
  await at(0, 6);
  if (Number(seconds) === 0) {
    // The colours settle after half a second of repaints.
    await page.waitForTimeout(600);
    await drawn(2);
    await page.screenshot({ path: out });
  } else {
    const pictures = [];
    for (let i = 0; i < seconds * rate; ++i) {
      await at(i / rate, 2);
      const raw = await page.evaluate(
        ([wide, high]) =>
          new Promise((done) =>
            requestAnimationFrame(() => {
              const copy = Object.assign(document.createElement("canvas"), { width: wide, height: high });
              const context = copy.getContext("2d");
              context.drawImage(document.getElementById("stage"), 0, 0, wide, high);
              const bytes = context.getImageData(0, 0, wide, high).data;
              let text = "";
              for (let k = 0; k < bytes.length; k += 32768)
                text += String.fromCharCode(...bytes.subarray(k, k + 32768));
              done(btoa(text));
            }),
          ),
        [w, h],
      );
      pictures.push(Buffer.from(raw, "base64"));
    }
    writeFileSync(out, animation(pictures));
  }
  if (await page.evaluate(() => window.softhand.counts.bad)) fail("the page refused a frame");
} finally {
  await browser.close();
  server.close();
}
