"""Study of Lady Windermere's fan: the global error as a sum of local defects, carried on."""
