from examples.skills.study import main

main()
