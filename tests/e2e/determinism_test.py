#!/usr/bin/python3
"""The same capture, seed and options give the same samples, bit for bit: any block size, any workers, offline or through
the daemon."""
import numpy as np

from support import SHARED, STORED_CAPTURE, RustleTest, daemon, main, read_wav, rustle


class BitExact(RustleTest):
    def captures(self):
        """Three captures: shared ones where they are, else the stored one under three seeds."""
        names = ["blender_table", "blender_crumple", "arcsim_crumple"]
        paths = [SHARED / f"captures/{name}.npz" for name in names]
        if all(path.exists() for path in paths):
            return [(self.import_npz(path), []) for path in paths]
        return [(STORED_CAPTURE, ["--seed", seed]) for seed in (0, 1, 2)]

    def samples(self, capture, *options):
        wav = self.folder / "out.wav"
        rustle("render", capture, "-o", wav, *options)
        return read_wav(wav)[1]

    def test_blocks_and_workers(self):
        for capture, options in self.captures():
            with self.subTest(capture=capture.stem, options=options):
                reference = self.samples(capture, *options)
                self.assertGreater(np.abs(reference).max(), 0)
                for more in (("--block-size", 64), ("--block-size", 1000), ("--workers", 2), ("--block-size", 1000, "--workers", 2)):
                    np.testing.assert_array_equal(self.samples(capture, *options, *more), reference)

    def test_through_the_daemon(self):
        for number, (capture, options) in enumerate(self.captures()):
            with self.subTest(capture=capture.stem, options=options):
                reference = self.samples(capture, *options)
                wav = self.folder / "heard.wav"
                ends_folder = self.folder / f"d{number}"
                ends_folder.mkdir()
                with daemon(ends_folder) as ends:
                    rustle("replay", capture, "--clock", "simulation", "--control", ends["control"], "--wav", wav, *options)
                np.testing.assert_array_equal(read_wav(wav)[1], reference)

    def test_seeds_differ(self):
        capture, _ = self.captures()[0]
        self.assertGreater(np.abs(self.samples(capture, "--seed", 1) - self.samples(capture, "--seed", 2)).max(), 0)


if __name__ == "__main__":
    main()
