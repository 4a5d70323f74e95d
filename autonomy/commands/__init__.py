"""What the verbs of `autonomy` do; each is imported only when it is used."""
