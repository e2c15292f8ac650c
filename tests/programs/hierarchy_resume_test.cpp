// A hierarchy that was killed, ran out of disk or found its work files cut is finished by a rerun, with the bytes of an
// uninterrupted build. LUMIGRID_LONG_TESTS in the environment: more kills, larger meshes.
#include <sched.h>
#include <sys/mount.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <functional>
#include <random>
#include <thread>

#include "tests/programs/resumed_build.h"

namespace {

using programs::expectOneLineError;
using programs::longTests;
using programs::readText;
using programs::run;
using programs::sizeOf;
namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using Arguments = std::vector<std::string>;

class HierarchyResume : public programs::ResumedBuild {
 protected:
  // Expects the same of a copy of a stopped build whose journal holds `journal` instead.
  void expectRerunFinishesWith(const std::string& journal, const std::string& mesh, const std::string& stopped,
                               const std::string& bytes, const std::string& what) {
    const std::string scene = path("scene");
    fs::remove_all(scene);
    fs::copy(stopped, scene, fs::copy_options::recursive);
    programs::writeText(workFile(scene, "patches"), journal);
    expectRerunFinishes(mesh, scene, bytes, what);
  }

  // Leaves a build that was stopped when its journal held leaves and groups.
  struct Late {
    std::string mesh;
    std::string bytes;  // the same build's file, not stopped
    std::string stopped;
    std::string journal;
  };
  Late late_;
  void stopLate() {
    late_.mesh = sample("300000");
    late_.bytes = uninterrupted(late_.mesh);
    late_.stopped = path("stopped");
    const std::string journal = workFile(late_.stopped, "patches");
    const std::uint64_t most = late_.bytes.size() / 10 * 8;
    ASSERT_NO_FATAL_FAILURE(
        killedWhen(late_.mesh, late_.stopped, [&] { return sizeOf(journal) > most && hasStage(late_.stopped, 2); }));
    late_.journal = readText(journal);
  }
};

TEST_F(HierarchyResume, killedAtRandomMomentsItEndsWithTheSameBytes) {
  const std::string mesh = sample(longTests() ? "500000" : "300000");
  const auto begin = Clock::now();
  const std::string bytes = uninterrupted(mesh);
  const std::chrono::duration<double> whole = Clock::now() - begin;

  std::mt19937 random(11);
  std::uniform_real_distribution<double> fraction(0.0, 1.0);
  const std::string scene = path("scene");
  std::string delays;
  for (int kills = 0; kills < (longTests() ? 20 : 5);) {
    const double share = fraction(random);
    delays += std::to_string(share) + " ";
    const auto end = Clock::now() + std::chrono::duration_cast<Clock::duration>(share * whole);
    kills += killWhen(build(mesh, scene), [&] { return Clock::now() >= end; }) ? 1 : 0;
    ASSERT_FALSE(HasFailure()) << "killed after shares " << delays;
    if (!fs::exists(scene + "/scene.json")) continue;
    EXPECT_TRUE(readText(scene + "/patch.lgp") == bytes) << "killed after shares " << delays;
    fs::remove_all(scene);
    delays.clear();
  }
  expectRerunFinishes(mesh, scene, bytes, "killed after shares " + delays);
}

// Colours that are shown as scanned need no normals, and what light shades does.
TEST_F(HierarchyResume, normalsAreStoredWhereLightShadesTheModel) {
  const std::string mesh = sample("20000");
  const std::string usual = uninterrupted(mesh);
  const std::string with_normals = uninterrupted(mesh, {"--normals", "vertices"});
  EXPECT_LT(usual.size(), with_normals.size());
  EXPECT_EQ(usual, uninterrupted(mesh, {"--normals", "facets"}));
  EXPECT_EQ(usual, uninterrupted(mesh, {"--light", "unlit"}));
  EXPECT_EQ(with_normals, uninterrupted(mesh, {"--light", "soft"}));
  EXPECT_EQ(usual, uninterrupted(mesh, {"--light", "soft", "--normals", "facets"}));
}

TEST_F(HierarchyResume, killedInEveryStageItEndsWithTheSameBytes) {
  const std::string mesh = sample("200000");
  const std::string bytes = uninterrupted(mesh);
  const std::string scene = path("scene");
  for (const char* file : {"vertices", "triangles", "buckets", "stage1", "stage2", "patches"}) {
    int kills = 0;
    while (kills < 2 && killWhen(build(mesh, scene), [&] { return fs::exists(workFile(scene, file)); }))
      ++kills;  // the second time at the same stage of a resumed build, or soon in it
    expectRerunFinishes(mesh, scene, bytes, std::string("killed when there was ") + file);
    fs::remove_all(scene);
  }
}

// A disk that lost power may have a stage's record and not all of its files.
TEST_F(HierarchyResume, workFilesThatAreCutAreMadeAgain) {
  const std::string mesh = sample("300000");
  const std::string bytes = uninterrupted(mesh);
  const std::string stopped = path("stopped"), scene = path("scene");
  ASSERT_NO_FATAL_FAILURE(killedWhen(mesh, stopped, [&] {
    return fs::exists(workFile(stopped, "stage1")) && !fs::exists(workFile(stopped, "stage2"));
  }));
  if (!fs::exists(workFile(stopped, "vertices"))) GTEST_SKIP() << "it had gone on before it was killed";
  for (const char* file : {"vertices", "triangles"}) {
    for (const std::uintmax_t part : {0, 1, 2}) {  // thirds that are left
      fs::remove_all(scene);
      fs::copy(stopped, scene, fs::copy_options::recursive);
      fs::resize_file(workFile(scene, file), sizeOf(workFile(scene, file)) / 3 * part);
      expectRerunFinishes(mesh, scene, bytes, std::string(file) + " cut");
    }
  }
}

// The output appears whole, but its directory is not a finished scene at once.
TEST_F(HierarchyResume, killedWhileTheOutputIsWrittenItEndsWithTheSameBytes) {
  const std::string mesh = sample("300000");
  const std::string bytes = uninterrupted(mesh);
  const std::string scene = path("scene");
  auto anyFileOf = [&](const std::string& front) {
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(scene, error))
      if (entry.path().filename().string().rfind(front, 0) == 0 && !entry.is_directory(error)) return true;
    return false;
  };
  for (const std::string& front : {std::string("patch.lgp.part"), std::string("patch.lgp")}) {
    killWhen(build(mesh, scene), [&] { return anyFileOf(front); });
    if (!fs::exists(scene + "/scene.json")) expectRerunFinishes(mesh, scene, bytes, "killed when there was " + front);
    fs::remove_all(scene);
  }
  // A kill just before or just after the renaming leaves this.
  const std::string stopped = path("stopped");
  ASSERT_NO_FATAL_FAILURE(killedWhen(mesh, stopped, [&] {
    return sizeOf(workFile(stopped, "patches")) > bytes.size() / 10 * 8 && hasStage(stopped, 2);
  }));
  for (const char* name : {"patch.lgp.part4711", "patch.lgp"}) {
    for (const bool work_files : {true, false}) {
      if (!work_files && std::string(name) != "patch.lgp") continue;  // they go only behind the renaming
      fs::copy(stopped, scene, fs::copy_options::recursive);
      programs::writeText(scene + "/" + name, std::string(name) == "patch.lgp" ? bytes : bytes.substr(0, 5000));
      if (!work_files) fs::remove_all(scene + "/patch.lgp.work");
      expectRerunFinishes(mesh, scene, bytes, std::string(name) + (work_files ? ", work files" : ", no work files"));
      fs::remove_all(scene);
    }
  }
}

TEST_F(HierarchyResume, filesHalfWrittenByAKilledRunGoWithTheOthers) {
  ASSERT_NO_FATAL_FAILURE(stopLate());
  for (const char* file : {"stage3.part4711", "key.part4711"})
    programs::writeText(workFile(late_.stopped, file), "half");
  expectRerunFinishes(late_.mesh, late_.stopped, late_.bytes, "with files half written");
}

TEST_F(HierarchyResume, killedBeforeTheSceneIsNamedItsFilesAreMadeAgain) {
  const std::string mesh = path("facade.obj"), scene = path("facade.scene");
  ASSERT_EQ(run("lumigrid", {"sample", "--shape", "facade", "--triangles", "200", "--texels", "50", "-o", mesh}).status,
            0);
  const Arguments build{"build", mesh, "-o", scene, "--methods", "patch"};
  ASSERT_EQ(run("lumigrid", build).status, 0);
  const std::string patches = readText(scene + "/patch.lgp"), textures = readText(scene + "/texture.lgt");
  for (const char* last : {"/scene.json", "/build.json"}) fs::remove(scene + last);
  const auto rerun = run("lumigrid", build);
  ASSERT_EQ(rerun.status, 0) << rerun.err;
  EXPECT_TRUE(readText(scene + "/patch.lgp") == patches);
  EXPECT_TRUE(readText(scene + "/texture.lgt") == textures);
}

TEST_F(HierarchyResume, aJournalWithAnyTailGoesOnBehindItsLastWholeRecord) {
  ASSERT_NO_FATAL_FAILURE(stopLate());
  const auto& [mesh, bytes, stopped, whole] = late_;
  ASSERT_GT(whole.size(), 10000U);

  std::string noise(5000, '\0');
  std::mt19937 random(3);
  for (char& c : noise) c = static_cast<char>(random());
  // The journal's leaves take two thirds of the output's bytes, so these lose groups.
  const std::size_t cut = bytes.size() / 10 * 7;
  std::string rotten = whole;
  rotten[cut] = static_cast<char>(~rotten[cut]);
  const std::pair<const char*, std::string> tails[] = {
      {"untouched", whole},
      {"noise behind", whole + noise},
      {"zeros behind", whole + std::string(5000, '\0')},
      {"the front of a record behind", whole + whole.substr(0, 2000)},
      {"cut by a byte", whole.substr(0, whole.size() - 1)},
      {"cut in the middle of the groups", whole.substr(0, cut)},
      {"one byte of a group turned", rotten},
  };
  for (const auto& [what, text] : tails) expectRerunFinishesWith(text, mesh, stopped, bytes, what);
}

// Leaves that the journal has lost cannot be made again from a bucket whose bytes were given back to the disk.
TEST_F(HierarchyResume, aJournalThatLostLeavesEndsWithTheSameBytesToo) {
  ASSERT_NO_FATAL_FAILURE(stopLate());
  const auto& [mesh, bytes, stopped, whole] = late_;
  std::string rotten = whole;
  rotten[100000] = static_cast<char>(~rotten[100000]);
  const std::pair<const char*, std::string> losses[] = {{"cut in the middle", whole.substr(0, bytes.size() / 4)},
                                                        {"cut in the first record", whole.substr(0, 30)},
                                                        {"emptied", ""},
                                                        {"one byte turned", rotten}};
  for (const auto& [what, text] : losses) expectRerunFinishesWith(text, mesh, stopped, bytes, what);
}

TEST_F(HierarchyResume, cutWorkFilesNeverEndInOtherBytes) {
  const std::string mesh = sample("300000");
  const std::string bytes = uninterrupted(mesh);
  const std::string stopped = path("stopped");
  ASSERT_NO_FATAL_FAILURE(killedWhen(
      mesh, stopped, [&] { return sizeOf(workFile(stopped, "patches")) > bytes.size() / 4 && hasStage(stopped, 2); }));
  const std::string scene = path("scene");
  for (const char* name : {"buckets", "stage1", "stage2", "key"}) {
    for (const double share : {0.0, 0.5}) {
      fs::remove_all(scene);
      fs::copy(stopped, scene, fs::copy_options::recursive);
      const auto size = sizeOf(workFile(scene, name));
      fs::resize_file(workFile(scene, name), static_cast<std::uintmax_t>(share * static_cast<double>(size)));
      const std::string what = std::string(name) + " cut to " + std::to_string(share);
      const auto rerun = run("lumigrid", build(mesh, scene));
      if (rerun.status != 0) {
        expectOneLineError(rerun, 1, {});
        EXPECT_FALSE(fs::exists(scene + "/patch.lgp")) << what;
        fs::remove_all(scene + "/patch.lgp.work");  // as the error asks
        expectRerunFinishes(mesh, scene, bytes, what);
      } else {
        expectFinished(scene, bytes, what);
      }
    }
  }
}

TEST_F(HierarchyResume, aRerunOfAnotherMeshDoesNotTakeTheWorkFiles) {
  const std::string mesh = sample("300000");
  const std::string scene = path("scene");
  ASSERT_NO_FATAL_FAILURE(
      killedWhen(mesh, scene, [&] { return sizeOf(workFile(scene, "patches")) > 100000 && hasStage(scene, 2); }));
  ASSERT_EQ(run("lumigrid", {"sample", "--triangles", "100000", "--seed", "5", "--force", "-o", mesh}).status, 0);
  const std::string bytes = uninterrupted(mesh);
  expectRerunFinishes(mesh, scene, bytes, "another mesh of the same name");
}

TEST_F(HierarchyResume, memoryAndThreadsDoNotChangeTheBytes) {
  // The long mesh is larger than what the least memory sorts at once.
  const std::string mesh = sample(longTests() ? "3000000" : "150000");
  const std::string bytes = uninterrupted(mesh);
  const Arguments choices[] = {{"--memory", "256M", "--threads", "1"},
                               {"--memory", "8G", "--threads", "2"},
                               {"--memory", "256M", "--threads", "3"},
                               {"--memory", "8G", "--threads", "4"}};
  for (const Arguments& choice : choices) {
    const std::string scene = path("scene");
    const auto built = run("lumigrid", build(mesh, scene, choice));
    ASSERT_EQ(built.status, 0) << built.err;
    expectFinished(scene, bytes, choice[1] + " " + choice[3]);
    fs::remove_all(scene);
  }
}

TEST_F(HierarchyResume, tooLittleMemoryIsRefused) {
  const std::string mesh = smallMesh();
  for (const char* memory : {"10M", "255M", "1"}) {
    const auto refused = run("lumigrid", build(mesh, path("scene"), {"--memory", memory}));
    expectOneLineError(refused, 1, {"--memory"});
    EXPECT_FALSE(fs::exists(path("scene"))) << "something stayed";
  }
}

TEST_F(HierarchyResume, workFilesElsewhereAreGoneInTheEnd) {
  const std::string mesh = sample("100000");
  const std::string bytes = uninterrupted(mesh);
  fs::create_directories(path("work"));
  const Arguments elsewhere{"--tmpdir", path("work")};
  auto started = [&] {
    std::error_code error;
    for (const auto& entry : fs::recursive_directory_iterator(path("work"), error))
      if (entry.path().filename() == "patches") return true;
    return false;
  };
  ASSERT_NO_FATAL_FAILURE(killedWhen(mesh, path("scene"), started, elsewhere));
  for (const auto& entry : fs::directory_iterator(path("scene"))) EXPECT_EQ(entry.path().filename(), "build.lock");
  const auto rerun = run("lumigrid", build(mesh, path("scene"), elsewhere));
  ASSERT_EQ(rerun.status, 0) << rerun.err;
  expectFinished(path("scene"), bytes, "--tmpdir");
  EXPECT_TRUE(fs::is_empty(path("work")));
}

class SplatResume : public HierarchyResume {
 protected:
  SplatResume() {
    method_ = "qsplat";
    file_ = "qsplat.lgq";
  }
  void expectRerunsFinishFrom(const std::string& mesh, const std::string& bytes,
                              std::initializer_list<const char*> files) {
    const std::string scene = path("scene");
    for (const char* file : files) {
      int kills = 0;
      while (kills < 2 && killWhen(build(mesh, scene), [&] { return fs::exists(workFile(scene, file)); })) ++kills;
      expectRerunFinishes(mesh, scene, bytes, std::string("killed when there was ") + file);
      fs::remove_all(scene);
    }
  }
};

TEST_F(SplatResume, killedInEveryStageItEndsWithTheSameBytes) {
  const std::string mesh = sample("800000");  // several tiles, and long enough for stages to reach the disk
  expectRerunsFinishFrom(mesh, uninterrupted(mesh),
                         {"vertices", "buckets", "stage1", "stage2", "stage3", "nodes", "stage4", "runs"});
}

TEST_F(SplatResume, aJournalWithAnyTailEndsWithTheSameBytes) {
  const std::string mesh = sample("800000");
  const std::string bytes = uninterrupted(mesh);
  const std::string stopped = path("stopped"), scene = path("scene");
  ASSERT_NO_FATAL_FAILURE(
      killedWhen(mesh, stopped, [&] { return sizeOf(workFile(stopped, "nodes")) > 0 && hasStage(stopped, 3); }));
  const std::string whole = readText(workFile(stopped, "nodes"));
  std::string rotten = whole;
  if (!rotten.empty()) rotten[rotten.size() / 2] = static_cast<char>(~rotten[rotten.size() / 2]);
  for (const auto& [what, text] :
       {std::pair<const char*, std::string>{"untouched", whole},
        {"zeros behind", whole + std::string(5000, '\0')},
        {"cut by a byte", whole.substr(0, whole.size() - std::min<std::size_t>(1, whole.size()))},
        {"cut in the middle", whole.substr(0, whole.size() / 2)},
        {"emptied", ""},
        {"one byte turned", rotten}}) {
    fs::remove_all(scene);
    fs::copy(stopped, scene, fs::copy_options::recursive);
    programs::writeText(workFile(scene, "nodes"), text);
    expectRerunFinishes(mesh, scene, bytes, what);
  }
}

TEST_F(SplatResume, memoryAndThreadsDoNotChangeTheBytes) {
  const std::string mesh = sample(longTests() ? "3000000" : "400000");
  const std::string bytes = uninterrupted(mesh);
  for (const Arguments& choice :
       {Arguments{"--memory", "256M", "--threads", "1"}, Arguments{"--memory", "8G", "--threads", "3"}}) {
    const std::string scene = path("scene");
    const auto built = run("lumigrid", build(mesh, scene, choice));
    ASSERT_EQ(built.status, 0) << built.err;
    expectFinished(scene, bytes, choice[1] + " " + choice[3]);
    fs::remove_all(scene);
  }
}

TEST_F(SplatResume, memoryStaysUnderItsCeiling) {
  const std::string mesh = sample(longTests() ? "20000000" : "2000000");
  const auto built = run("lumigrid", build(mesh, path("scene"), {"--memory", "256M", "--threads", "4", "--json"}));
  ASSERT_EQ(built.status, 0) << built.err;
  EXPECT_LT(built.peak_memory_bytes, std::uint64_t{256} << 20);
  // The program's own figure is the kernel's, read a moment before its end.
  const std::string name = "\"peak_memory_bytes\":";
  const std::size_t at = built.out.find(name);
  ASSERT_NE(at, std::string::npos) << built.out;
  EXPECT_NEAR(std::stod(built.out.substr(at + name.size())), static_cast<double>(built.peak_memory_bytes), 16.0e6);
}

class CodedSplatResume : public SplatResume {
 protected:
  CodedSplatResume() { options_ = {"--qsplat-coded"}; }
};

TEST_F(CodedSplatResume, killedInALateStageItEndsWithTheSameBytes) {
  const std::string mesh = sample("400000");
  expectRerunsFinishFrom(mesh, uninterrupted(mesh), {"nodes", "stage4", "runs", "plain"});
}

TEST_F(CodedSplatResume, theFormIsTheScenesAndAnotherOneIsRefused) {
  const std::string mesh = sample("20000");
  const std::string bytes = uninterrupted(mesh);
  const std::string scene = path("scene");
  ASSERT_EQ(run("lumigrid", build(mesh, scene)).status, 0);
  const auto plain = run("lumigrid", {"build", mesh, "-o", scene, "--methods", "qsplat", "--quiet"});
  EXPECT_EQ(plain.status, 1);
  EXPECT_NE(plain.err.find("of other meshes or options"), std::string::npos) << plain.err;
  // Without meshes the scene's own options count, and patches may be added.
  const auto again = run("lumigrid", {"build", "-o", scene, "--quiet"});
  EXPECT_EQ(again.status, 0) << again.err;
  EXPECT_NE(again.out.find("nothing was to be done"), std::string::npos) << again.out;
  ASSERT_EQ(run("lumigrid", {"build", mesh, "-o", scene, "--methods", "patch", "--quiet"}).status, 0);
  EXPECT_TRUE(readText(scene + "/qsplat.lgq") == bytes);
  const auto both = run("lumigrid", build(mesh, scene));
  EXPECT_NE(both.out.find("nothing was to be done"), std::string::npos) << both.out << both.err;
  const auto info = run("lumigrid", {"info", scene});
  EXPECT_NE(info.out.find(" coded, "), std::string::npos) << info.out;
  EXPECT_EQ(run("lumigrid", {"verify", scene}).status, 0);
  EXPECT_EQ(run("lumigrid", {"build", mesh, "-o", path("no"), "--methods", "patch", "--qsplat-coded"}).status, 2);
}

// A scene that has patches gets splats beside them, the same as alone, and stays finished meanwhile.
TEST_F(SplatResume, addedToAFinishedSceneTheyAreTheSame) {
  const std::string mesh = sample("50000");
  const std::string bytes = uninterrupted(mesh);
  const std::string scene = path("scene");
  ASSERT_EQ(run("lumigrid", {"build", mesh, "-o", scene, "--methods", "patch", "--quiet"}).status, 0);
  const std::string patches = readText(scene + "/patch.lgp");
  ASSERT_EQ(run("lumigrid", build(mesh, scene)).status, 0);
  EXPECT_TRUE(readText(scene + "/qsplat.lgq") == bytes);
  EXPECT_TRUE(readText(scene + "/patch.lgp") == patches);
  const auto verified = run("lumigrid", {"verify", scene});
  EXPECT_EQ(verified.status, 0) << verified.out << verified.err;
  const auto info = run("lumigrid", {"info", scene});
  EXPECT_NE(info.out.find("splats:"), std::string::npos) << info.out;
  EXPECT_NE(info.out.find("hierarchy:"), std::string::npos) << info.out;
  const auto again = run("lumigrid", {"build", mesh, "-o", scene, "--methods", "patch,qsplat", "--quiet"});
  EXPECT_EQ(again.status, 0) << again.err;
  EXPECT_NE(again.out.find("nothing was to be done"), std::string::npos) << again.out;
  // verify finds a changed byte.
  std::string rotten = bytes;
  rotten[bytes.size() / 2] = static_cast<char>(~rotten[bytes.size() / 2]);
  programs::writeText(scene + "/qsplat.lgq", rotten);
  EXPECT_EQ(run("lumigrid", {"verify", scene}).status, 1);
}

// Dicing decides the bytes of the file, so another dicing makes another scene.
TEST_F(SplatResume, anotherDicingIsAnotherScene) {
  programs::writeText(path("two.off"), "OFF\n4 2 0\n0 0 0\n9 0 0\n0 9 0\n9 9 1\n3 0 1 2\n3 1 3 2\n");
  const std::string mesh = path("two.off"), scene = path("scene");
  ASSERT_EQ(run("lumigrid", build(mesh, scene)).status, 0);
  const std::string diced = readText(scene + "/qsplat.lgq");
  const auto other = run("lumigrid", build(mesh, scene, {"--qsplat-dice", "0"}));
  EXPECT_EQ(other.status, 1);
  EXPECT_NE(other.err.find("--force"), std::string::npos) << other.err;
  ASSERT_EQ(run("lumigrid", build(mesh, scene, {"--qsplat-dice", "0", "--force"})).status, 0);
  EXPECT_LT(readText(scene + "/qsplat.lgq").size(), diced.size());
  const auto again = run("lumigrid", build(mesh, scene, {"--qsplat-dice", "0"}));
  EXPECT_EQ(again.status, 0) << again.err;
  EXPECT_EQ(run("lumigrid", build(mesh, scene, {"--qsplat-dice", "-1"})).status, 2);
}

// A user who may not mount file systems may do so in a user namespace of his own, where the kernel allows those.
bool enterOwnNamespace() {
  const std::string user = "0 " + std::to_string(::getuid()) + " 1";
  const std::string group = "0 " + std::to_string(::getgid()) + " 1";
  if (::unshare(CLONE_NEWUSER | CLONE_NEWNS) != 0) return false;
  programs::writeText("/proc/self/setgroups", "deny");
  programs::writeText("/proc/self/uid_map", user);
  programs::writeText("/proc/self/gid_map", group);
  return true;
}

// Mounts a file system in memory; the destructor unmounts it.
class SmallDisk {
 public:
  explicit SmallDisk(const std::string& path) : path_(path) { fs::create_directories(path); }
  ~SmallDisk() {
    if (mounted_) ::umount2(path_.c_str(), MNT_DETACH);
  }
  bool mount(std::uint64_t kilobytes) {
    mounted_ = call(kilobytes, 0) || (errno == EPERM && enterOwnNamespace() && call(kilobytes, 0));
    return mounted_;
  }
  bool resize(std::uint64_t kilobytes) const { return call(kilobytes, MS_REMOUNT); }

 private:
  bool call(std::uint64_t kilobytes, unsigned long flags) const {
    return ::mount("none", path_.c_str(), "tmpfs", flags, ("size=" + std::to_string(kilobytes) + "k").c_str()) == 0;
  }
  std::string path_;
  bool mounted_ = false;
};

TEST_F(HierarchyResume, aFullDiskIsNamedAndTheRerunFinishes) {
  const std::string mesh = sample("100000");
  const std::string bytes = uninterrupted(mesh);
  for (const std::uint64_t kilobytes : {600, 3000, 4500}) {
    SmallDisk disk(path("disk"));
    if (!disk.mount(kilobytes)) GTEST_SKIP() << "cannot mount a small file system here: " << std::strerror(errno);
    const std::string scene = path("disk/scene");
    const auto full = run("lumigrid", build(mesh, scene));
    expectOneLineError(full, 1, {"space"});
    EXPECT_NE(full.err.find("disk"), std::string::npos) << "not named: " << full.err;
    EXPECT_FALSE(fs::exists(scene + "/patch.lgp")) << kilobytes << " kB";
    ASSERT_TRUE(disk.resize(64000)) << std::strerror(errno);
    expectRerunFinishes(mesh, scene, bytes, std::to_string(kilobytes) + " kB");
  }
}

TEST_F(SplatResume, aFullDiskIsNamedAndTheRerunFinishes) {
  const std::string mesh = sample("100000");
  const std::string bytes = uninterrupted(mesh);
  for (const std::uint64_t kilobytes : {600, 3000, 5500}) {
    SmallDisk disk(path("disk"));
    if (!disk.mount(kilobytes)) GTEST_SKIP() << "cannot mount a small file system here: " << std::strerror(errno);
    const std::string scene = path("disk/scene");
    const auto full = run("lumigrid", build(mesh, scene));
    expectOneLineError(full, 1, {"space"});
    EXPECT_FALSE(fs::exists(scene + "/qsplat.lgq")) << kilobytes << " kB";
    ASSERT_TRUE(disk.resize(64000)) << std::strerror(errno);
    expectRerunFinishes(mesh, scene, bytes, std::to_string(kilobytes) + " kB");
  }
}

// Somebody else fills the disk while the build is at work, so checking the free space beforehand does not help.
class FullDisk : public HierarchyResume {
 protected:
  struct Moment {
    const char* name;
    std::function<bool(const std::string& scene)> is_here;
    std::vector<std::string> files;  // one of them is what cannot be written then, under the scene
  };

  void fill(std::size_t bytes) const { std::ofstream(path("disk/filler"), std::ios::app) << std::string(bytes, 'x'); }

  // Stops the build at the moment, fills the disk, and lets the build go on. `in_time`: it was still that moment.
  programs::Outcome filledAt(const Moment& moment, const std::string& mesh, const std::string& scene, bool& in_time) {
    const pid_t pid = programs::start("lumigrid", build(mesh, scene, {"--threads", "1"}), path("filled"));
    siginfo_t ended{};
    while (!moment.is_here(scene) && ended.si_pid == 0) {
      ::waitid(P_PID, static_cast<id_t>(pid), &ended, WEXITED | WNOHANG | WNOWAIT);
      std::this_thread::sleep_for(std::chrono::microseconds(50));
    }
    ::kill(pid, SIGSTOP);
    ::waitid(P_PID, static_cast<id_t>(pid), &ended, WSTOPPED | WEXITED | WNOWAIT);
    ended = {};
    in_time = moment.is_here(scene);
    fill(std::size_t{64} << 20);
    ::kill(pid, SIGCONT);
    // The room of files that the build deletes is taken, too: else its last levels may fit into that.
    while (::waitid(P_PID, static_cast<id_t>(pid), &ended, WEXITED | WNOHANG | WNOWAIT) == 0 && ended.si_pid == 0) {
      fill(std::size_t{1} << 20);
      std::this_thread::sleep_for(std::chrono::microseconds(200));
    }
    programs::Outcome full;
    full.status = programs::wait(pid);
    full.err = readText(path("filled.err"));
    return full;
  }
};

TEST_F(FullDisk, atEveryMomentItIsNamedAndTheRerunFinishes) {
  const std::string mesh = sample("400000");
  const std::string bytes = uninterrupted(mesh);
  auto work = [](const std::string& name) { return "/patch.lgp.work/" + name; };
  auto journal = [this](const std::string& scene) { return sizeOf(workFile(scene, "patches")); };
  auto outputBegun = [this](const std::string& scene) {
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(scene, error))
      if (entry.path().filename().string().rfind("patch.lgp.part", 0) == 0) return true;
    return false;
  };
  const Moment moments[] = {
      {"spool",
       [this](const std::string& scene) { return fs::exists(workFile(scene, "vertices")); },
       {work("vertices"), work("triangles")}},
      {"buckets",
       [this](const std::string& scene) { return sizeOf(workFile(scene, "buckets")) > 0; },
       {work("buckets")}},
      // The journal's patches are not packed: leaves take two thirds of the output's bytes, all levels over twice them.
      {"leaves",
       [&](const std::string& scene) { return journal(scene) > 0 && journal(scene) < bytes.size() / 10 * 8; },
       {work("patches"), work("stage")}},
      {"a middle level",
       [&](const std::string& scene) { return journal(scene) > bytes.size() / 2 * 3 && !outputBegun(scene); },
       {work("patches"), work("stage")}},
      {"the output", outputBegun, {"/patch.lgp"}},
  };
  const std::string scene = path("disk/scene");
  for (const Moment& moment : moments) {
    SCOPED_TRACE(moment.name);
    bool met = false;
    for (int attempt = 0; attempt < 20 && !met; ++attempt) {
      SmallDisk disk(path("disk"));
      if (!disk.mount(64000)) GTEST_SKIP() << "cannot mount a small file system here: " << std::strerror(errno);
      bool in_time = false;
      const programs::Outcome full = filledAt(moment, mesh, scene, in_time);
      met = in_time && std::any_of(moment.files.begin(), moment.files.end(), [&](const std::string& file) {
              const std::size_t at = full.err.find(scene + file);
              return at != std::string::npos && full.err.find(": cannot write: ", at) != std::string::npos;
            });
      // A busy machine may look too late: then a later stage fails, or none.
      if (!met && full.status == 0) continue;
      expectOneLineError(full, 1, {scene, "left on device", "free some"});
      if (met) expectOneLineError(full, 1, {"No space left", "; free some space and run the same command again"});
      EXPECT_FALSE(fs::exists(scene + "/patch.lgp"));
      EXPECT_FALSE(outputBegun(scene)) << "half an output stayed";
      fs::remove(path("disk/filler"));
      expectRerunFinishes(mesh, scene, bytes, moment.name);
      if (HasFailure()) return;
    }
    EXPECT_TRUE(met) << "no write failed at this moment";
  }
}

}  // namespace
