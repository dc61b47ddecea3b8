class Chpm < Formula
  desc "Triangle meshes of any size at every level of detail, with proven errors"
  homepage "@ADDRESS@"
  version "@VERSION@"
  license any_of: ["MIT", "Apache-2.0"]

  on_macos do
    on_arm do
      url "@ADDRESS@/chpm-@VERSION@-aarch64-apple-darwin.tar.xz"
      sha256 "@SHA256 chpm-@VERSION@-aarch64-apple-darwin.tar.xz@"
    end
    on_intel do
      url "@ADDRESS@/chpm-@VERSION@-x86_64-apple-darwin.tar.xz"
      sha256 "@SHA256 chpm-@VERSION@-x86_64-apple-darwin.tar.xz@"
    end
  end

  on_linux do
    on_arm do
      url "@ADDRESS@/chpm-@VERSION@-aarch64-unknown-linux-gnu.tar.xz"
      sha256 "@SHA256 chpm-@VERSION@-aarch64-unknown-linux-gnu.tar.xz@"
    end
    on_intel do
      url "@ADDRESS@/chpm-@VERSION@-x86_64-unknown-linux-gnu.tar.xz"
      sha256 "@SHA256 chpm-@VERSION@-x86_64-unknown-linux-gnu.tar.xz@"
    end
  end

  def install
    bin.install "chpm"
    man1.install Dir["man/*.1"]
    bash_completion.install "completions/chpm.bash" => "chpm"
    zsh_completion.install "completions/chpm.zsh" => "_chpm"
    fish_completion.install "completions/chpm.fish"
  end

  test do
    system bin/"chpm", "demo", "--keep", "demo"
    assert_path_exists testpath/"demo/demo.chpm"
  end
end
