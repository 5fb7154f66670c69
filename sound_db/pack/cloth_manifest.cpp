#include "sound_db/pack/cloth_manifest.h"

namespace rustle::pack {

std::vector<std::string> named_files(const ClothManifest& manifest) {
  const ClothCorpus& corpus = manifest.corpus;
  std::vector<std::string> names = {corpus.causal.file, corpus.symmetric.file, corpus.friction.file};
  for (const auto* set : {&corpus.causal, &corpus.symmetric}) {
    if (!set->warp_file.empty()) names.push_back(set->warp_file);
  }
  for (const SourceRecording& recording : corpus.recordings) names.push_back(recording.file);
  if (corpus.crumpling) {
    for (const ClothCrumplingUnit& unit : corpus.crumpling->units) names.push_back(unit.file);
  }
  return names;
}

}  // namespace rustle::pack
