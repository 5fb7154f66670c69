#include "sound_db/build/build_manifest.h"

namespace rustle::build {

std::string example_manifest() {
  return R"(# What a folder of recordings holds, for `rustle pack build FOLDER -o PACK`. Save it in the folder as recordings.toml.
# Lengths are in m, speeds in m/s, times in s, levels in dB. What is commented out is optional and shows its default.

[pack]
material = "printer-paper"          # as sheets name it
touched_surface = "wooden-table"    # what it slides on
licence = "CC0-1.0"                 # of the recordings, and so of the pack
origin = "recorded by A. Person, 2024"
# grammage_kg_per_m2 = 0.080         # mass per area: heavier sheets tear louder
# name = "printer-paper-on-wooden-table"
# version = "1.0.0"
# rate_hz = 48000                   # of the pack; recordings of any rate are converted
# highpass_hz = 100                 # against rumble, 5th order; 0: only the offset is removed

[geometry]                          # where the microphone was; [recording.geometry] overrides it for one entry
distance_m = 1.0
elevation_deg = 90                  # above the plane; 90: on the sheet's axis
plane = false                       # whether the sheet was over a reflecting plane (a table)
compression = 0.0                   # how much shorter the bent edge's chord is than the edge: 0.3 for 30 %

# [crumpling]
# compression = 0.10                # of the sheets whose bend was reversed
# clac_amplitude_m = 0.004          # the event that a clac stands for: area times change of curvature, in m
# units_per_point = 12              # at most; those that stand out of the noise most are kept

[friction]
reference_speed = 0.1               # what the spectra are brought to
# speed_exponent = 1.0              # amplitude grows as speed to this power; rough contacts: about 0.75
# fft_size = 1024
# gain_sigma = 0.35                 # slow random gain of slides: spread of its logarithm ...
# gain_cutoff_hz = 80               # ... and how fast it moves
[friction.geometry]                 # slides are usually recorded on the table itself
distance_m = 1.0
elevation_deg = 30
plane = true
compression = 0.3

# [cloth]                           # a pack of cloth (An et al. 2012) instead: of recordings of class cloth, slide, crumple
# units_per_s = 240                 # how short the units are that sound is put together of; 60 where it has a rhythm
# binaural = false                  # true: two channels at once; else every channel is a source of its own
# widths = [20, 50, 10]             # of the filters over time of the three features, in units
# lambda = 100                      # of the warp: the more the stiffer; `rustle pack calibrate` fits it
# look_ahead = 5
# d_max = 2.0
# cool_off = 20
# wale_spacing = 0.0                # of ribs that click, in m: 0.0014 for corduroy
# patch_area = 0.01                 # of the cloth that slides were recorded with, in m2
# speed_threshold = 0.02            # what was never faster is silent
# slowest = 0.05                    # speeds of the friction spectra, in equal ratios ...
# fastest = 2.0
# speeds = 14
# speed_tolerance = 0.06            # ... and how near a moment's speed must be to count for one
# pause_db = 60                     # recordings are cut where they fall so far below their loudest moment

# One entry for each kind of recording.
#
# files          a name or a list; * and ? stand for parts of a name, ** for folders as well
# class          flap     a bent sheet whose bend is reversed, page turns: each sound is one unit
#                clac     single clicks of a sheet that cannot swing freely
#                crumple  crumpling by hand: clacs are cut out of it
#                slide    a sheet sliding: its mean spectrum is taken
#                cloth    varied motion, what packs of cloth are made of; left out of packs of paper
#                tear     left out of the pack; `rustle validate --against` compares with tears and cloth
# l_r, l_c       flaps and slides of bent sheets: length of the straight rulings, and of the free curved borders, which is
#                twice the bent edge. Left out: told by the file's name, r100_c200 in mm.
# constrained    true: a slide of a flat sheet
# speed          slides: in m/s, or speed_track = "file.csv" with lines "time,speed"
# time           [from, to] of the file
# channel        1, 2 ...; 0: the mean of all
# gain_db        added to the file; use it where the recording gain was changed
# session        recordings of one session keep their levels relative to each other; the sessions are brought to the
#                reference levels one by one
# whole          true: the file is one unit, already cut
# keep_levels    false: all units equally loud (the default of crumple, whose clacs have unknown sizes)
# threshold_db   sounds reach this, relative to the loudest window; left out, it is chosen from the recording
# window_ms      of the energy that is compared with the threshold; 20. Less separates denser clacs
# lead_ms        flaps: at most so much rustle before the loudest moment; 50

[[recording]]
files = "flaps/*.wav"               # flaps/r100_c200_1.wav: a sheet of 10 x 10 cm
class = "flap"

[[recording]]
files = ["page turn.wav"]
class = "flap"
l_r = 0.20
l_c = 0.30
time = [0.5, 9.5]
session = "another day"

[[recording]]
files = "crumpling.wav"
class = "crumple"

[[recording]]
files = "slides/bent_10cm.wav"
class = "slide"
l_r = 0.10
l_c = 0.20
speed = 0.1

[[recording]]
files = "slides/flat.wav"
class = "slide"
constrained = true
speed_track = "slides/flat_speed.csv"
)";
}

}  // namespace rustle::build
