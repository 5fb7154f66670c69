#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "server/observation/observation.h"
#include "server/synthesis/sound_model.h"
#include "server/synthesis/unit_loudness.h"
#include "sound_db/dsp/random.h"

/// Events below what the mesh shows (P13): crackling as a marked point process. Parents are Poisson along the bending
/// activity, evenly over the time of a frame; each draws aftershocks by Omori's law (rate ∝ 1/t), the more the stronger it
/// is; all energies are independent and Pareto. An energy of 1 is a clac at the level it was made for: the event's amplitude
/// (P2) is then the pack's constrained reference, 1 mm, and amplitudes go with √energy.
namespace rustle::synthesis {

inline constexpr double kFineExponent = 1.45;      ///< τ of p(E) ∝ E^-τ
inline constexpr double kFineRange = 1e3;          ///< E_max / E_min
inline constexpr double kFineParents_per_m = 120;  ///< per metre of bending activity
inline constexpr double kFineAftershocks = 3;      ///< of a parent, mean
inline constexpr double kFineEnergy_per_m = 20;    ///< mean energy of all events per metre of activity
inline constexpr double kFineFirst_s = 0.0003;     ///< aftershocks follow after this ...
inline constexpr double kFineLast_s = 0.2;         ///< ... to this
inline constexpr double kClacAmplitude_m = 0.001;  ///< of an event of energy 1
inline constexpr double kMostFineGain_db = 12;
inline constexpr std::size_t kMostFineParents = 4000;  ///< of one patch in one frame, whatever a simulator does
/// Energy of the strongest event there can be: kFineEnergy_per_m over the number of events per metre is the mean.
double strongest_fine_energy();

struct FineEvent {
  SampleTime onset = 0;
  double energy = 0;        ///< kFineRange below strongest_fine_energy(), to it
  std::uint32_t patch = 0;  ///< of the list it was drawn from, its index
  bool aftershock = false;
};

/// What a draw depends on, besides the bending: nothing else.
struct FineFrame {
  std::uint64_t seed = 0;  ///< of the session
  sheet::SheetId sheet = 0;
  std::uint64_t frame = 0;  ///< of the sheet, counted
  SampleTime from = 0, to = 0;
  std::uint32_t rate_hz = 48000;
};

/// The events that one frame's bending feeds, aftershocks included (they may lie after `to`), by rising onset. Appends.
/// Pure.
void draw_fine_events(const FineFrame& frame, std::span<const observation::BendingPatch> bending,
                      std::vector<FineEvent>& out);

/// The burst that a visible event carries, after it (Omori, 2-300 ms), so that its sound begins with it: energies are
/// relative to the strongest there can be (1). Appends, by rising onset. Pure.
inline constexpr double kBurstEvents = 12;
inline constexpr double kBurstPeak_db = -14;  ///< of its strongest event under the visible event's own peak
void draw_burst(std::uint64_t seed, sheet::SheetId sheet, std::uint64_t event, SampleTime onset, std::uint32_t rate_hz,
                std::vector<FineEvent>& out);

/// Plan half: fine events as clacs at random places of their patch, held until they are due. [analysis worker]
class FineEventsPlan {
 public:
  explicit FineEventsPlan(const PlanOptions& options) : options_(options) {}

  /// What the frame's bending feeds.
  void plan(const SheetPlan& sheet, const observation::Observation& observation, SampleTime earliest);
  /// The burst of a visible event whose loudest unit peaks at `peak` (at 1 m on the axis).
  void plan_burst(const SheetPlan& sheet, const observation::CrumplingEvent& event, double peak, SampleTime onset,
                  SampleTime earliest);
  /// Hands over what starts before `until`, by start, then by event.
  void release(SampleTime until, std::vector<Cue>& out);
  std::uint64_t missing() const { return missing_; }
  /// The material's units are about to go. \pre none of its events wait
  void forget(const Material& material) { loudness_.forget(material); }

 private:
  struct Place {
    sheet::Vec3d position_m = sheet::Vec3d::Zero(), normal = sheet::Vec3d::UnitZ();
    double normal_spread = 0;
    Eigen::Matrix3d covariance_m2 = Eigen::Matrix3d::Zero();
  };
  bool wanted(const SheetPlan& sheet) const;
  /// False: the pack has no clac.
  bool add(const SheetPlan& sheet, std::uint64_t id, SampleTime onset, SampleTime earliest, double gain, const Place& place);

  PlanOptions options_;
  std::map<sheet::SheetId, std::uint64_t> frames_;  ///< planned so far
  std::map<sheet::SheetId, std::uint32_t> last_;    ///< unit of each sheet's last event
  std::vector<CrumpleCue> waiting_;
  std::vector<FineEvent> drawn_;
  UnitLoudness loudness_;
  std::uint64_t missing_ = 0;
};

}  // namespace rustle::synthesis
