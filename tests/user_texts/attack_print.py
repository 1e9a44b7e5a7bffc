print('<script>alert(1)</script>' * 10_000)
