#!/usr/bin/python3
"""`rustle compare`: a render beside itself, beside another gain and beside another mode; mistakes named."""
import json

from support import STORED_CAPTURE, RustleTest, main, rustle


class Compare(RustleTest):
    def rendered(self, name, *options):
        wav, events = self.folder / f"{name}.wav", self.folder / f"{name}.jsonl"
        rustle("render", STORED_CAPTURE, "-o", wav, "--events", events, *options)
        return wav, events

    def compared(self, a, b, *options):
        return json.loads(rustle("compare", a[0], b[0], "--events", a[1], b[1], "--json", *options).stdout)

    def test_a_render_beside_others_of_itself(self):
        first, again, quieter = self.rendered("first"), self.rendered("again"), self.rendered("quieter", "--gain-db", "-6")
        same = self.compared(first, again)
        self.assertTrue(same["sound"]["identical"])
        self.assertGreater(same["events"]["all"]["reference"], 0)
        for score in same["events"].values():
            self.assertEqual((score["precision"], score["recall"], score["timing_error_ms"]["p95"]), (1, 1, 0))
        sound = self.compared(first, quieter)["sound"]
        self.assertFalse(sound["identical"])
        self.assertAlmostEqual(sound["level_dbfs"]["other"] - sound["level_dbfs"]["reference"], -6, delta=0.3)
        self.assertLess(sound["mean_band_difference_db"], 0.5)

    def test_events_that_are_missing_or_late_are_counted(self):
        first = self.rendered("first")
        lines = [json.loads(line) for line in first[1].read_text().splitlines()]
        whole = [line for line in lines if line["continues"] is None]
        kept = [{**line, "time_s": line["time_s"] + 0.003} for line in whole[1:]]
        late = self.folder / "late.jsonl"
        late.write_text("".join(json.dumps(line) + "\n" for line in kept))
        score = self.compared(first, (first[0], late), "--tolerance", 4)["events"]["all"]
        self.assertEqual((score["reference"], score["other"], score["matched"]), (len(whole), len(kept), len(kept)))
        self.assertAlmostEqual(score["bias_ms"], 3, delta=1e-3)
        self.assertEqual(self.compared(first, (first[0], late), "--tolerance", 1)["events"]["all"]["matched"], 0)

    def test_the_page_and_mistakes(self):
        first = self.rendered("first")
        page = self.folder / "page.html"
        told = rustle("compare", first[0], first[0], "--events", first[1], first[1], "--report", page).stdout
        self.assertIn("the same, sample for sample", told)
        self.assertIn("</svg>", page.read_text())
        slow = self.rendered("slow", "--rate", 44100)
        rustle("compare", first[0], slow[0], status=1)
        rustle("compare", first[0], self.folder / "nowhere.wav", status=1)
        rustle("compare", first[0], first[0], "--events", first[0], first[1], status=1)
        rustle("compare", first[0], first[0], "--report", first[0], status=2)


if __name__ == "__main__":
    main()
