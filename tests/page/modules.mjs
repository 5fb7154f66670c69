/** Modules of the page without the page: compiled by the esbuild that Vite brings. */
import { createRequire } from "node:module";
import { fileURLToPath, pathToFileURL } from "node:url";

const WEB = new URL("../../server/page/web/", import.meta.url);
const require = createRequire(pathToFileURL(createRequire(new URL("package.json", WEB)).resolve("vite")));
const esbuild = require("esbuild");

export async function load(path) {
  const built = await esbuild.build({
    entryPoints: [fileURLToPath(new URL(`src/${path}`, WEB))],
    bundle: true,
    format: "esm",
    write: false,
  });
  return import(`data:text/javascript;base64,${Buffer.from(built.outputFiles[0].contents).toString("base64")}`);
}
